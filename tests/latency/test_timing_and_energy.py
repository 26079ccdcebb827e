"""The timing error is the programmed latency; the actuator's energy is what the ledger says."""

from pathlib import Path

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.time_series import F_A, XI_P
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.setup import load
from tests.latency.modes_alone import modes_alone

SHORT = ["run.duration_s=0.0013", "run.accuracy=0.02"]


@pytest.mark.parametrize("law", ["slope_threshold", "force_feedback"])
@pytest.mark.parametrize("latency_us", [1, 30])
def test_the_force_is_late_by_the_latency_and_nothing_else(law: str, latency_us: int) -> None:
    """With a gain so small that the impact does not feel it, the force is the same, shifted."""
    keys = [*SHORT, f"controller.law={law}", "controller.kappa=1e-9"]
    at_once = simulate(load("aluminium-3mm", keys)).truth[F_A]
    late = simulate(load("aluminium-3mm", [*keys, f"controller.latency_us={latency_us}"])).truth[
        F_A
    ]
    assert np.flatnonzero(late)[0] - np.flatnonzero(at_once)[0] == latency_us
    np.testing.assert_allclose(late[latency_us:], at_once[:-latency_us], rtol=1e-5, atol=1e-18)


@pytest.mark.parametrize("latency_us", [0, 40])
@pytest.mark.parametrize("kappa", [0.8, -0.5])
def test_the_ledger_s_injected_energy_is_force_times_way(
    latency_us: int, kappa: float, tmp_path: Path
) -> None:
    """Added up from the rows, which show the whole way where no spring is under the actuator."""
    plate = modes_alone("aluminium-3mm", 0.02, tmp_path / "modes.csv")
    scene = load("aluminium-3mm", [*SHORT, *plate,
                                   f"controller.kappa={kappa}",
                                   f"controller.latency_us={latency_us}"])  # fmt: skip
    run = simulate(scene)
    work = float(np.sum(run.truth[F_A][:-1] * np.diff(run.truth[XI_P])))
    assert run.balance.injected_j == pytest.approx(work, rel=1e-9)
    assert abs(run.balance.injected_j) > 1e-9 * run.balance.energy_start_j


@pytest.mark.parametrize("law", ["slope_threshold", "predicted", "velocity_feedback"])
@pytest.mark.parametrize("latency_us", [0, 12])
def test_plate_sphere_and_actuator_exchange_the_same_energy(law: str, latency_us: int) -> None:
    """Work on the plate = what the sphere lost + what the actuator fed in (no damping)."""
    scene = load("aluminium-3mm", ["run.duration_s=0.0013", f"controller.law={law}",
                                   "controller.kappa=0.4", f"controller.latency_us={latency_us}",
                                   "plate.loss_factor=0.0"])  # fmt: skip
    run = simulate(scene)
    plate = sum(i.plate_energy_j for i in impacts_in(scene.plant, run.truth))
    balance = run.balance
    mechanical = balance.kinetic_j + balance.gravity_j + balance.contact_j
    lost = balance.energy_start_j - mechanical
    # The last step's work is not in the rows.
    assert plate == pytest.approx(lost + balance.injected_j, rel=2e-3)
    taken = balance.modal_j + balance.truncated_dissipated_j
    assert taken == pytest.approx(lost + balance.injected_j, rel=1e-9)


def test_a_force_after_the_contact_only_feeds_the_plate() -> None:
    """At 40 us the ball has left: the plate gains what the actuator gives, the ball nothing."""
    late = metrics_of_case(load("aluminium-3mm", [*SHORT, "controller.latency_us=40"]))
    free = metrics_of_case(load("aluminium-3mm", [*SHORT, "controller.law=off"]))
    assert late.rebound_percent == pytest.approx(100.0, abs=1e-6)
    assert late.injected_j > 0.0
    gained = late.plate_energy_j - free.plate_energy_j
    assert gained == pytest.approx(late.injected_j, rel=1e-3)
