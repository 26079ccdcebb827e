"""What --json may replace: nothing but what --json wrote."""

import json
from importlib.metadata import version
from pathlib import Path

import pytest

from tests.hertzloop.test_cli import SHORT, call, here, said

__all__ = ["here"]  # the fixture


@pytest.mark.parametrize("name", ["mine.mcap", "mine.py", "mine.toml", "tuned.json"])
def test_it_leaves_the_files_of_others_alone(name: str, here: Path) -> None:
    (here / name).write_text('{\n  "settings": 1\n}\n')
    result = call("run", "aluminium-3mm", *SHORT, "--json", name)
    assert result.exit_code == 2
    assert f"--json = {name}: exists and was not written by --json" in said(result)
    assert (here / name).read_text() == '{\n  "settings": 1\n}\n'
    assert not (here / "aluminium-3mm.mcap").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["run", "aluminium-3mm", *SHORT, "--out", "a.mcap", "--json", "./a.mcap"],
        ["run", "aluminium-3mm", *SHORT, "--json", "aluminium-3mm.mcap"],
        ["sweep", "--over", "sensors.bits=4,5", "-o", "a.csv", "--json", "link/a.csv"],
        ["sweep", "--over", "sensors.bits=4,5", "-o", "a.csv", "--json", "a.csv.json"],
        ["sweep", "--over", "sensors.bits=4,5", "-o", "a.csv", "--json", "a.csv.partial"],
    ],
)
def test_it_is_no_other_output_of_the_command(words: list[str], here: Path) -> None:
    (here / "link").symlink_to(here)
    result = call(*words)
    assert result.exit_code == 2
    assert f"--json = {Path(words[-1])}: is another output of this command" in said(result)
    assert list(here.iterdir()) == [here / "link"]


def test_an_earlier_one_and_an_empty_one_are_replaced(here: Path) -> None:
    (here / "a.json").touch()
    for duration in ("0.0011", "0.0012"):
        call("run", "aluminium-3mm", "--transport", "compiled", "--overwrite", "--json", "a.json",
             "--set", f"run.duration_s={duration}")  # fmt: skip
        data = json.loads((here / "a.json").read_text())
        assert data["steps"] == round(1e6 * float(duration))
        assert data["hertzloop"] == version("hertzloop")


def test_a_file_that_came_meanwhile_is_left_alone(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the results of a search, whose folder and names --json may hit."""
    monkeypatch.setattr("hertzloop.cli.outputs.check_json", lambda *_: None)
    (here / "a.json").write_text("{}")
    result = call("run", "aluminium-3mm", *SHORT, "--json", "a.json")
    assert result.exit_code == 1
    assert "It was not changed" in said(result)
    assert (here / "a.json").read_text() == "{}"
