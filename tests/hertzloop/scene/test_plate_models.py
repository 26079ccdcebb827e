"""Theory and truncated modes of a plate as scenes: what is chosen, recorded, refused and said."""

from dataclasses import replace

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import Impact, impacts_in
from hertzloop.plant.plant import Balance
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.scene.setup import Setup, load
from tests.hertzloop.scenes import aluminium_3mm

SHORT = ["run.duration_s=0.0011", "run.plate_model=modal"]
DAMPED = "plate.tail=damped"
DAMPER = ["contact.damping=hunt_crossley", "contact.restitution=0.5"]


def test_the_residual_mode_is_taken_where_it_is_known():
    for source, settings, damped in (
        ("oak-20mm", [], True),
        ("aluminium-3mm", SHORT, True),
        ("aluminium-3mm", [*SHORT, "run.plate_model=infinite"], False),
        ("aluminium-3mm", [*SHORT, "plate.tail=spring"], False),
        ("aluminium-3mm", [*SHORT, "plate.contact_point_m=[0.004, 0.2]"], False),
        ("aluminium-3mm", [*SHORT, "plate.contact_point_m=[0.004, 0.2]", DAMPED], True),
        ("aluminium-3mm", [*SHORT, "actuator.mass_kg=1e-3"], False),
        ("thesis-aluminium", [], False),
    ):
        assert load(source, settings).plant.damped_residual is damped, settings


# Samples of 1 us on finer steps; the force of a sample acts 1 us after it, as with steps of 1 us.
FINE = ["run.step_ns=250", "sensors.every_steps=4", "controller.latency_us=0.75"]
DAMPED_CONTACT = ["controller.law=off", "contact.damping=hunt_crossley"]


def impact_of(setup: Setup, limit_hz: float, damped: bool) -> tuple[Impact, Balance]:
    """First impact with modes up to a limit, and a damped mode or a spring for the others."""
    spec = replace(setup.plant, frequency_limit_hz=limit_hz, damped_residual=damped)
    done = simulate(setup, own_plant=ModalPlant(spec))
    return impacts_in(spec, done.truth)[0], done.balance


# Errors of the plate energy with a spring and with a damped mode, from an independent solver.
@pytest.mark.parametrize(
    ("settings", "limit_hz", "spring", "damped", "digits"),
    [
        ([*DAMPED_CONTACT, "contact.restitution=0.7"], 250e3, -3.4e-3, 1.0e-5, 1e-5),
        ([*DAMPED_CONTACT, "contact.restitution=0.2"], 250e3, -1.2e-2, -7.3e-5, 2e-5),
        (["controller.v_thr_m_s=-0.6"], 125e3, None, 3.0e-4, 5e-5),
        (["controller.v_thr_m_s=-0.6"], 250e3, -1.3e-3, 1.5e-4, 5e-5),
    ],
)
def test_errors_of_both_models_of_the_truncated_modes(settings, limit_hz, spring, damped, digits):
    start = ["run.lead_in_s=2.5e-6", "run.plate_model=modal", "run.duration_s=60e-6"]
    setup = aluminium_3mm(*start, *settings, *FINE)
    best, _ = impact_of(setup, 4e6, damped=True)
    by_mode, balance = impact_of(setup, limit_hz, damped=True)
    assert by_mode.plate_energy_j / best.plate_energy_j - 1.0 == pytest.approx(damped, abs=digits)
    rebound = by_mode.rebound_speed_m_s - best.rebound_speed_m_s
    assert abs(rebound / best.impact_speed_m_s) < 5e-5
    assert balance.modal_dissipated_j > 0.0
    assert max(abs(balance.energy_residual), abs(balance.momentum_residual)) < 1e-10
    if spring is not None:
        by_spring, _ = impact_of(setup, limit_hz, damped=False)
        energy = by_spring.plate_energy_j / best.plate_energy_j - 1.0
        assert energy == pytest.approx(spring, rel=0.15)


def error(*settings: str) -> float:
    """The error that a run expects."""
    return aluminium_3mm(*settings).expected_error


def test_a_run_expects_what_the_steps_of_a_held_force_cost():
    """It knows no smaller error than 0.4 kappa (hold/T)^2, however many modes."""
    tight = [*SHORT, "run.accuracy=3e-4"]
    held = error(*tight)
    assert held == pytest.approx(0.4 * 0.8 / 26.85**2, rel=0.01)
    assert error(*tight, "sensors.every_steps=2") == pytest.approx(4.0 * held)
    for free in ("controller.law=off", "actuator.bandwidth_hz=1e5"):
        assert error(*tight, free) == pytest.approx(3e-4)


@pytest.mark.parametrize(
    "setting",
    [
        "sensors.bits=12",
        "sensors.every_steps=2",
        "sensors.noise_rms=1e-9",
        "sensors.fault=stuck",
        "controller.bits=12",
        "controller.jitter_us=1",
        "controller.latency_trace=[0,3]",
        "controller.clock_ppm=10",
        "controller.drop_out_probability=0.1",
        "controller.slew_n_s=1e9",
        "actuator.stuck_from_s=0.001",
    ],
)
def test_what_makes_steps_in_a_force_is_known(setting):
    smooth = ["sensors.bits=ideal", "controller.bits=ideal", "controller.full_scale_n=1e3"]
    harmless = ["controller.latency_us=3", "sensors.low_pass_hz=1e6", "actuator.dead_time_us=1"]
    assert aluminium_3mm(*smooth, *harmless).infinite_plate.smooth
    assert not aluminium_3mm(*smooth, setting).infinite_plate.smooth
