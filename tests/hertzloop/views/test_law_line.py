"""Which law really ran: the controller's word against the scene's, in `inspect` and the report."""

from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from hertzloop.bus.messages_pb2 import ControllerReport, RunEnd
from hertzloop.loop.run_options import RunOptions
from hertzloop.recordings.recording import Recording
from hertzloop.results.assessed_run import RunReport
from hertzloop.results.inspection import inspected
from hertzloop.results.recorded import law_of
from hertzloop.scene.toml import to_toml
from hertzloop.views.details import law_line
from hertzloop.views.report import print_inspection, print_run
from tests.hertzloop.scenes import aluminium_3mm, recorded

# Two contacts.
SCENE = aluminium_3mm("run.duration_s=0.15", "run.accuracy=0.02", "controller.v_thr_m_s=-0.6")


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
def test_what_is_said(law, line):
    assert law_line(law_of(recording(law))) == line
    lost = Recording(Path("a.mcap"), "no TOML")
    assert law_line(law_of(lost)) == "not reported by the controller"


def test_a_run_that_another_law_made(tmp_path):
    """A recording whose controller said so: neither `inspect` nor the report claims the scene's."""
    made = recorded(SCENE, tmp_path / "a.mcap")
    assert law_line(law_of(made)) == "slope_threshold"
    foreign = made.ends["controller"].report
    foreign.law, foreign.law_digest = "[b]mine[/b] 7", ""
    found = inspected(made, against_none=True)
    stats = {"wall_s": 1.0, "exchanges": 1}
    ran = RunReport(SCENE, RunOptions(), found, found.assessment, made.balance, stats)
    said = "[b]mine[/b] 7 (the scene says slope_threshold)"
    for show in (
        lambda console: print_inspection(console, inspected(made)),
        lambda console: print_run(console, ran),
    ):
        printed = StringIO()
        show(Console(width=200, file=printed))
        assert said in printed.getvalue()
    assert "It is unknown whether later impacts are predictable." in printed.getvalue()
