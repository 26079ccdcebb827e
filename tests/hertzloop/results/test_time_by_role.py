"""How the wall time of a run was spent: what `--details` and `--json` state."""

import pytest

from tests.hertzloop.commands import hertzloop
from tests.hertzloop.scenes import json_in
from tests.tiers import default

SHORT = ["aluminium-3mm", "--set", "run.duration_s=0.002", "--set", "controller.law=force_feedback"]


def row_of(printed: str) -> str:
    words = " ".join(printed.replace("│", " ").split())
    return words.split("time by role: ")[1].split("; real-time")[0]


@pytest.mark.full
@pytest.mark.parametrize("way", default([[], ["--pace", "0.01"]], [[]]))
def test_the_parts_lie_within_the_wall_time(way, tmp_path):
    more = ["--details", "--json", "a.json", "-o", "a.mcap"]
    done = hertzloop("run", *SHORT, *way, *more, cwd=tmp_path)
    data = json_in(tmp_path / "a.json")
    busy, waited_s = data["busy_s"], data["waited_s"]
    assert list(busy) == ["plant", "controller", "recorder"]
    assert 0.0 < waited_s <= data["wall_s"]
    assert busy["plant"] == pytest.approx(data["wall_s"] - waited_s)
    assert 0.0 <= busy["controller"] < data["wall_s"]
    assert busy["recorder"] > 0.0
    row = row_of(done.stdout)
    assert row.startswith(f"plant {busy['plant']:.3g} s, controller ")
    assert f"the plant waited {waited_s:.3g} s" in row
