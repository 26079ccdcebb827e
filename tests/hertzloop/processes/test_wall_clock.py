"""A wall clock that is set during a run, forth and back: the run does not notice."""

import os

import pytest

from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from tests.hertzloop.commands import hertzloop

# Imported by every Python process that finds it: each look at the clock is an hour off the last.
LEAPING = """
import itertools, os, time
was, turns = time.time, itertools.count()
time.time = lambda: was() + 3600.0 * (-1) ** next(turns) * (next(turns) % 5)
time.time_ns = lambda: int(1e9 * time.time())
def leaps(): print("the clock leaps", file=open({seen!r}, "a"))
leaps()
os.register_at_fork(after_in_child=leaps)
"""


@pytest.mark.full
def test_a_clock_that_is_set_changes_nothing(tmp_path):
    seen = tmp_path / "seen"
    (tmp_path / "sitecustomize.py").write_text(LEAPING.format(seen=str(seen)))
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    words = ("run", "aluminium-3mm", "--set", "run.duration_s=0.003", "--out")
    steady, leaping = tmp_path / "steady.mcap", tmp_path / "leaping.mcap"
    hertzloop(*words, str(steady))
    hertzloop(*words, str(leaping), env={**os.environ, "PYTHONPATH": path})
    assert len(seen.read_text().splitlines()) >= 4  # launcher and roles
    found = read(leaping)
    assert found.problems == []
    assert first_difference(read(steady), found) is None
