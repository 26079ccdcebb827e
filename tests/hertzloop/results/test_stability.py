"""An unstable loop is called so, from when on, and no other one is; its numbers stay finite."""

import re

import numpy as np
import pytest

from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.loop import events as loop_events
from hertzloop.loop.simulate import simulate
from hertzloop.plant.actuator_kernels import MOST_N
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.time_series import F_A, XI_P
from hertzloop.results.cases import CaseState, UnstableLoop, metrics_of_case
from hertzloop.results.statistics import UNSTABLE, stability_of
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup, load
from hertzloop.studies.cases.evaluate import run_case
from hertzloop.studies.cases.rows import without_result
from tests.hertzloop.commands import hertzloop
from tests.hertzloop.scenes import aluminium_3mm, json_in, recorded

SHORT = "run.duration_s=0.0015"
EXPLODES = [
    "aluminium-20mm",
    "--set",
    "controller.law=velocity_feedback",
    "--set",
    "controller.kappa=0.4",
]


def impact_j(scene: Setup) -> float:
    sphere = scene.plant.sphere
    return sphere.mass_kg * GRAVITY_M_S2 * sphere.drop_height_m


@pytest.mark.full
def test_a_loop_that_explodes_is_called_unstable(tmp_path):
    ran, inspected = tmp_path / "run.json", tmp_path / "inspect.json"
    file = str(tmp_path / "a.mcap")
    words = ["--transport", "compiled", "--out", file, "--json", str(ran)]
    run = hertzloop("run", *EXPLODES, *words)
    inspect = hertzloop("inspect", file, "--json", str(inspected))
    found = [json_in(path)["stability"] for path in (ran, inspected)]
    assert found[0] == found[1]
    assert found[0]["unstable"]
    assert found[0]["most_injected"] > 1e6
    assert found[0]["of_contact"] > 1e6
    assert 0.001 < found[0]["since_s"] < 0.01
    for done in (run, inspect):
        # The run is whole and says what such a loop does: no failure of the run.
        assert "UNSTABLE" in done.stdout
        assert f"{found[0]['since_s'] * 1e3:.4g} ms" in done.stdout
        assert "dB" not in done.stdout


@pytest.mark.parametrize("name", ["aluminium-20mm", "sylomer-20mm", "offcentre-6mm"])
def test_no_shipped_scene_and_no_law_is_called_unstable(name):
    for law in shipped_laws():
        own = {
            "constant": ["controller.duration_us=20", "controller.force_n=1e4"],
            "profile": ["controller.profile_n=[1e4, -1e4]"],
            "linear": ["controller.numerator=[-1.0]"],
        }
        keys = [f"controller.law={law}", "sensors.quantity=auto", *own.get(law, [])]
        if law in ("velocity_feedback", "acceleration_feedback"):
            keys += ["controller.kappa=0.05"]  # more than a few tenths do become unstable
        scene = load(name, keys)
        if scene.run.duration_s > 0.03:
            scene = load(name, [*keys, "run.duration_s=0.03"])
        found = stability_of(scene, simulate(scene).truth)
        assert not found.unstable, (law, found)
        assert not found.pumps, (law, found)
        assert found.since_s is None
        closed = law in ("off", "constant", "profile", "precomputed")
        assert closed or found.most_injected < 0.2 * UNSTABLE, (law, found)


def test_since_when():
    scene = aluminium_3mm("run.duration_s=0.002")
    e, rows = impact_j(scene), np.zeros((10, 9))
    rows[F_A] = 1.0
    # Work after every step: beyond the impact's energy, back, and beyond for good.
    rows[XI_P] = np.array([0.0, 0.5, 1.5, 0.9, 2.0, 8.0, 30.0, -20.0, 50.0]) * e
    found = stability_of(scene, rows)
    assert found.unstable
    assert found.since_s == pytest.approx(3 * scene.run.step_s)
    assert found.most_injected == pytest.approx(50.0)


def test_a_loop_that_pumps_is_told_by_the_energy_there_was():
    """More than the sphere brought, in sum, and not by decibels against a run without control."""
    scene = aluminium_3mm("controller.kappa=2", "controller.latency_us=2", SHORT)
    found = stability_of(scene, simulate(scene).truth)
    metrics = metrics_of_case(scene)
    assert found.pumps
    assert not found.unstable
    assert found.fed_in > 1.0
    assert found.since_s is not None
    assert metrics.pumps
    assert metrics.injected_j > metrics.impact_energy_j
    gentle = aluminium_3mm("controller.latency_us=2", SHORT)
    assert not metrics_of_case(gentle).pumps


def test_the_largest_force_is_told_in_units_of_the_rigid_contact():
    """A rigid, lossless Hertz contact of this sphere has a peak of about 85 N at 1 m/s."""
    setup = aluminium_3mm("run.duration_s=0.001")
    rows = np.zeros((10, 100))
    rows[F_A, 40] = 50.0
    found = stability_of(setup, rows)
    sphere = setup.plant.sphere
    energy_j = 0.5 * sphere.mass_kg * sphere.impact_speed_m_s**2
    stiffness = setup.plant.contact.stiffness
    rigid_n = stiffness * (2.5 * energy_j / stiffness) ** 0.6
    assert found.largest_force_n == 50.0
    assert found.of_contact == pytest.approx(50.0 / rigid_n, rel=1e-6)


def test_a_law_that_declares_itself_open_loop_is_never_unstable(tmp_path):
    """A user's law as much as a shipped one, whatever energy it feeds in."""
    found = []
    for declared in ("", "open_loop = True"):
        path = tmp_path / f"pump{len(found)}.py"
        path.write_text(f"{declared}\n\ndef command(p, s, samples, i):\n    return 3000.0\n")
        scene = aluminium_3mm(SHORT, "run.accuracy=0.1", f"controller.law={path}")
        found.append(stability_of(scene, simulate(scene).truth).unstable)
        assert bool(loaded_law(scene).not_linear) is bool(declared)
    assert found == [True, False]


RUN = ["run.accuracy=0.05", "run.duration_s=0.004"]
AWAY = [("velocity_feedback", 3.0), ("acceleration_feedback", -2.0)]


@pytest.mark.parametrize(("law", "kappa"), AWAY)
def test_a_runaway_is_an_unstable_case(law, kappa):
    scene = aluminium_3mm(*RUN, f"controller.law={law}", f"controller.kappa={kappa}")
    with pytest.raises(UnstableLoop, match="the closed loop is unstable: the actuator exchanges"):
        metrics_of_case(scene, "run")
    row = run_case(scene, "run", 0, {})
    assert row["state"] == CaseState.UNSTABLE
    assert row["status"].startswith("the closed loop is unstable")
    assert not without_result([row])
    run = simulate(scene)
    assert np.isfinite(run.truth).all()
    assert abs(run.truth[F_A]).max() == MOST_N
    assert abs(run.balance.energy_residual) < 1e-9


def test_events_that_are_too_many_are_counted(tmp_path, monkeypatch):
    """However the samples come in blocks."""
    monkeypatch.setattr(loop_events, "MOST", 1)
    scene = aluminium_3mm(*RUN)
    told = []
    for compiled in (True, False):
        file = tmp_path / f"{compiled}.mcap"
        events = recorded(scene, file, compiled).events
        told.append([(event.name, event.time_ns, event.message) for event in events])
    assert sorted(told[0]) == sorted(told[1])
    for name in ("plant", "controller"):
        *listed, last = [event for event in told[0] if event[0] == name]
        assert len(listed) == 1
        assert last[1] == scene.run.steps * scene.run.step_ns - scene.run.step_ns
        assert re.fullmatch(r"\d+ further events are not listed", last[2])
