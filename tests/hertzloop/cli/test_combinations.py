"""Every pair of features on the page of combinations: built, or refused with a remedy."""

import re

import pytest

from hertzloop.controller.law import LawError
from hertzloop.scene.controller import check_buildable
from hertzloop.scene.errors import SceneError
from tests.commands import succeed
from tests.hertzloop.own_laws import ROOT
from tests.hertzloop.scenes import aluminium_3mm

PAGE = (ROOT / "docs" / "reference" / "combinations.md").read_text()


def cells(row: str) -> list[str]:
    """The cells of a row of a table."""
    return [cell.strip() for cell in row.strip().strip("|").split("|")]


def table(heading: str) -> list[list[str]]:
    """The rows of the first table under a heading, without its head's line."""
    rows = [
        line
        for line in PAGE.partition(heading)[2].split("\n## ")[0].splitlines()
        if line.startswith("|")
    ]
    return [cells(row) for row in [rows[0], *rows[2:]]]


FEATURES = {name: settings.strip("`").split() for name, settings in table("## Features")[1:]}
(_, *COLUMNS), *ROWS = table("## Pairs")
SLOW = {"other edges"}  # seconds of modes
QUICK = {"infinite plate", "modes from a file"}


def tier(row: str, column: str) -> list[pytest.MarkDecorator]:
    """Pairs with many modes belong to `--all`."""
    slow = row in SLOW or (column.startswith("sensor") and row not in QUICK)
    return [pytest.mark.full] if slow else []


PAIRS = [
    pytest.param(row[0], column, verdict, marks=tier(row[0], column))
    for row in ROWS
    for column, verdict in zip(COLUMNS, row[1:], strict=True)
    if verdict
]


@pytest.fixture(scope="session")
def modes_file(tmp_path_factory):
    """Modes of the default plate, as a file."""
    path = tmp_path_factory.mktemp("combined") / "modes.csv"
    succeed("scene", "modes", "aluminium-3mm", "-o", path)
    return path


def test_the_page_knows_every_feature():
    assert {*COLUMNS, *(row[0] for row in ROWS)} <= {*FEATURES}
    assert {pair.values[2] for pair in PAIRS} == {"works", "refused"}


@pytest.mark.parametrize(("one", "other", "verdict"), PAIRS, ids=lambda x: re.sub(r"\W+", "-", x))
def test_a_pair_of_features(one, other, verdict, modes_file):
    settings = [
        setting.replace("MODES", str(modes_file))
        for name in (other, one)
        for setting in FEATURES[name]
    ]
    if verdict == "works":
        check_buildable(aluminium_3mm("run.duration_s=0.002", *settings))
        return
    with pytest.raises((SceneError, LawError)) as found:
        check_buildable(aluminium_3mm("run.duration_s=0.002", *settings))
    sentence = str(found.value)
    # The sentence names a key of each, and begins its remedy with a verb.
    assert re.search(r"\. (Use|Give|Remove|Leave|Choose|Set|Support|Add|Reduce)", sentence)
