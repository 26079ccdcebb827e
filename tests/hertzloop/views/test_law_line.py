"""Which law really ran: the controller's word against the scene's, in `inspect` and the report."""

from pathlib import Path

import pytest

from hertzloop.bus.messages_pb2 import ControllerReport, RunEnd
from hertzloop.recordings.recording import Recording
from hertzloop.results.recorded import law_of
from hertzloop.scene.toml import to_toml
from hertzloop.views.details import law_line
from tests.hertzloop.scenes import aluminium_3mm

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
