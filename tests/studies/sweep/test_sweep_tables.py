"""Tables and hints of a sweep on the screen."""

import re

from tests.commands import call, said, succeed

SHORT = ["--set", "run.accuracy=0.05", "--set", "run.plate_model=modal"]


def test_a_sweep_of_one_key_prints_each_case_and_a_hint_at_flight(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Velocity feedback acts as long as the plate moves, so that every case runs to its end.
    words = ["sweep", "aluminium-3mm", "--set", "controller.law=velocity_feedback",
             "--set", "controller.kappa=0.01", "--over", "controller.latency_us=0:2:1"]  # fmt: skip
    long = call(*words, *SHORT, "--set", "run.duration_s=0.1")
    assert long.exit_code == 0, long.output
    rows = [line.split("│")[1].strip() for line in long.output.splitlines() if "│" in line]
    assert rows[:3] == ["0.0", "1.0", "2.0"] or rows[:3] == ["0", "1", "2"]
    hint = re.search(r"--set run\.duration_s=(\S+) is about (\d+) times faster", said(long))
    assert hint, said(long)
    assert int(hint[2]) >= 3
    again = succeed(*words, *SHORT, "--set", f"run.duration_s={hint[1]}", "--overwrite")
    assert "is flight" not in again
