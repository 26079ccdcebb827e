"""Which law really ran: the controller's word against the scene's, in `inspect` and the report."""

from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from hertzloop.bus.messages_pb2 import ControllerReport, RunEnd
from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.results.metrics import free_metrics
from hertzloop.results.model import parts_of
from hertzloop.results.recorded import law_of
from hertzloop.results.run_report import RunReport
from hertzloop.results.verdict import assess_recording
from hertzloop.scene.setup import load
from hertzloop.scene.toml import to_toml
from hertzloop.views import inspection
from hertzloop.views.law_line import law_line
from hertzloop.views.run import print_run

SCENE = load("aluminium-3mm", ["run.duration_s=0.0012", "run.accuracy=0.1"])


def recording(law: str) -> Recording:
    end = RunEnd(report=ControllerReport(law=law))
    return Recording(Path("a.mcap"), to_toml(SCENE.scene), ends={"controller": end})


@pytest.mark.parametrize(
    ("law", "line"),
    [
        ("slope_threshold", "slope_threshold"),
        ("mine 1.2", "mine 1.2 (the scene says slope_threshold)"),
        ("", "not reported by the controller (the scene says slope_threshold)"),
        ("a\nb\x1b[31m", "a b[31m (the scene says slope_threshold)"),
        ("x" * 300, "x" * 200 + " (the scene says slope_threshold)"),
    ],
)
def test_what_is_said(law: str, line: str) -> None:
    assert law_line(law_of(recording(law))) == line
    lost = Recording(Path("a.mcap"), "no TOML")
    assert law_line(law_of(lost)) == "not reported by the controller"


def test_a_run_that_another_law_made(tmp_path: Path) -> None:
    """A recording whose controller said so: neither `inspect` nor the report claims the scene's."""
    path = tmp_path / "a.mcap"
    record_in_process(SCENE, path, compiled=True)
    recorded = read(path)
    assert law_line(law_of(recorded)) == "slope_threshold"
    foreign = recorded.ends["controller"].report
    foreign.law, foreign.law_digest = "[b]mine[/b] 7", ""
    assessed = assess_recording(SCENE, recorded, free_metrics(SCENE))
    assert recorded.balance is not None
    about = recorded.balance, parts_of(SCENE, recorded.balance)
    ran = RunReport(SCENE, recorded, assessed, *about, "zenoh", 1.0, 1)
    said = "[b]mine[/b] 7 (the scene says slope_threshold)"
    for show in (
        lambda console: inspection.show(console, inspection.inspected(recorded)),
        lambda console: print_run(console, ran),
    ):
        printed = StringIO()
        show(Console(width=200, file=printed))
        assert said in printed.getvalue()
