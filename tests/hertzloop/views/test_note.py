"""A note of the user: from `run` into the recording, and from there to every reader."""

import pytest

import hertzloop
from hertzloop.loop.run_options import LONGEST_NOTE, RunOptions
from hertzloop.recordings.reader import read
from tests.commands import call, refused
from tests.hertzloop.cli.test_cli import SHORT
from tests.hertzloop.scenes import json_in

NOTE = "-- new tip, 23 °C [bold]"


def test_a_note_passes_through_processes_to_every_reader(here):
    run = ["run", "aluminium-3mm", "--set", "run.duration_s=0.0015", "--json", "run.json"]
    assert call(*run, "-o", "a.mcap", "--note", NOTE).exit_code == 0
    assert json_in(here / "run.json")["note"] == NOTE
    assert read(here / "a.mcap").metadata["note"] == NOTE
    assert hertzloop.read("a.mcap").note == NOTE
    whole = call("inspect", "a.mcap", "--json", "inspect.json")
    assert f"\nNote: {NOTE}\n" in whole.output
    assert json_in(here / "inspect.json")["note"] == NOTE
    content = (here / "a.mcap").read_bytes()
    (here / "cut.mcap").write_bytes(content[: int(0.8 * len(content))])
    assert call("repair", "cut.mcap", "-o", "mended.mcap").exit_code == 0
    assert read(here / "mended.mcap").note == NOTE


@pytest.mark.parametrize(
    ("note", "sentence"),
    [
        ("x" * 1000, "note: has 1,000 characters. Shorten it to at most 500."),
        ("first\nsecond", r"note = 'first\nsecond': must be one line"),
        ("not \udcff UTF-8", r"note = 'not \udcff UTF-8': must be one line"),
    ],
)
def test_a_note_that_cannot_be_recorded_is_refused(here, note, sentence):
    for command in (["run", *SHORT], ["node", "recorder"]):
        refused(sentence, *command, "--note", note)
    assert list(here.iterdir()) == []
    assert RunOptions(note="x" * LONGEST_NOTE).note
