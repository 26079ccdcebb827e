"""What --json may replace: nothing but what --json wrote."""

from pathlib import Path

import pytest

import hertzloop
from tests.commands import call, refused, said
from tests.hertzloop.cli.test_cli import SHORT
from tests.hertzloop.scenes import json_in

RUN = ["run", "aluminium-3mm", *SHORT]
SWEEP = ["sweep", "--over", "sensors.bits=4,5", "-o", "a.csv"]


def test_it_leaves_the_files_of_others_alone(here, monkeypatch):
    theirs = '{\n  "settings": 1\n}\n'
    for name in ("mine.mcap", "mine.toml", "tuned.json"):
        (here / name).write_text(theirs)
        refused(f"--json = {name}: exists and was not written by --json", *RUN, "--json", name)
        assert (here / name).read_text() == theirs
        assert not (here / "aluminium-3mm.mcap").exists()
    # One that came meanwhile, as the results of a search.
    monkeypatch.setattr("hertzloop.cli.outputs.check_json", lambda *_: None)
    result = call(*RUN, "--json", "tuned.json")
    assert result.exit_code == 1
    assert "It was not changed" in said(result)
    assert (here / "tuned.json").read_text() == theirs


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ([*RUN, "--out", "a.mcap"], "./a.mcap"),
        (RUN, "aluminium-3mm.mcap"),
        (SWEEP, "link/a.csv"),
        (SWEEP, "a.csv.json"),
        (SWEEP, "a.csv.partial"),
    ],
)
def test_it_is_no_other_output_of_the_command(words, name, here):
    (here / "link").symlink_to(here)
    refused(f"--json = {Path(name)}: is another output of this command", *words, "--json", name)
    assert list(here.iterdir()) == [here / "link"]


def test_an_earlier_one_and_an_empty_one_are_replaced(here):
    (here / "a.json").touch()
    for steps in (1100, 1200):
        duration = ["--set", f"run.duration_s={steps}e-6"]
        call(*RUN[:-2], *duration, "--overwrite", "--json", "a.json")
        data = json_in(here / "a.json")
        assert (data["steps"], data["hertzloop"]) == (steps, hertzloop.__version__)
