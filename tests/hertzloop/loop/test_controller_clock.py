"""The controller's own clock in a scene: the closed loop, what knows it, and what refuses it."""

from pathlib import Path

import numpy as np
import pytest

from hertzloop.recordings.replay import as_rerun
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.controller import latencies_us
from hertzloop.studies.margin.flight import margin_of
from hertzloop.views import provenance, replaying
from tests.commands import as_options, succeed
from tests.hertzloop.scenes import aluminium_3mm, recorded

SHORT = ["run.duration_s=0.0013", "controller.law=force_feedback", "sensors.every_steps=4"]
DRIFT = ["controller.clock_ppm=20000", "controller.clock_phase=0.4"]


def digest(*settings: str) -> str:
    return metrics_of_case(aluminium_3mm(*SHORT, *settings)).digest


def test_equal_clocks_change_nothing():
    plain = aluminium_3mm(*SHORT)
    equal = aluminium_3mm(*SHORT, "controller.clock_ppm=0", "controller.clock_phase=0")
    assert equal.signal_path == plain.signal_path


def test_a_phase_alone_is_a_dead_time():
    later = digest("controller.clock_phase=0.5")
    assert later == digest("actuator.dead_time_us=2") != digest()
    assert not aluminium_3mm(*SHORT, "controller.clock_phase=0.5").signal_path.varies


def test_a_drift_is_the_trace_of_its_latencies():
    found = latencies_us(aluminium_3mm(*SHORT, *DRIFT))
    assert set(found) == {0.0, 1.0, 2.0, 3.0, 4.0}
    trace = f"controller.latency_trace={found.tolist()}"
    assert digest(*DRIFT) == digest(trace) == digest(*DRIFT, "run.seed=2") != digest()


@pytest.mark.parametrize("clock", [DRIFT, ["controller.clock_phase=0.5"]])
def test_a_trace_from_the_tick_is_added_to_the_wait(clock):
    trace = ["controller.latency_trace=[1, 0, 5]", "controller.latency_trace_from=tick"]
    waits, both = (latencies_us(aluminium_3mm(*SHORT, *clock, *more)) for more in ([], trace))
    assert waits.any()
    assert np.array_equal(both, waits + np.resize([1.0, 0.0, 5.0], len(waits)))


def test_the_margin_knows_a_phase_and_not_a_drift():
    law = ["controller.law=velocity_feedback", "controller.kappa=0.01", "sensors.every_steps=4"]
    later, dead = (
        margin_of(aluminium_3mm(*law, setting))
        for setting in ("controller.clock_phase=0.5", "actuator.dead_time_us=2")
    )
    assert later.applicable
    assert later.latency_limit_steps == dead.latency_limit_steps
    assert "controller.clock_ppm is not zero" in margin_of(aluminium_3mm(*(law + DRIFT))).reason


def test_the_latency_is_named_and_drawn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    setup = aluminium_3mm(*SHORT, *DRIFT)
    assert "clock +20000 ppm, phase 0.4" in provenance.control(setup)
    shown = replaying.prepare(recorded(setup, Path("a.mcap")), alone=True)
    (curve,) = next(plot.curves for plot in shown.plots if plot.key == "latency")
    assert np.array_equal(curve.values, latencies_us(setup))
    assert curve.time_ns[1] == 4000
    as_rerun.save(shown, Path("a.rrd"))
    assert Path("a.rrd").stat().st_size > 10_000
    words = [*as_options(SHORT + DRIFT), "--transport", "compiled", "--details", "-o", "b.mcap"]
    assert "mean latency" in succeed("run", "aluminium-3mm", *words)
