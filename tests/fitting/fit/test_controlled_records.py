"""`hertzloop fit` of records under a law: latency, gains and actuator of a closed loop."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.fitting.errors import FitError, RecordError
from hertzloop.fitting.fit.check import check
from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.free_keys import parse_free_key
from hertzloop.fitting.fit.impact_simulator import LoopSimulator
from hertzloop.fitting.fit.results import FitResult, KeyVerdict, ModelVerdict
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup, load
from tests.fitting.fitting import fitted

LATENCY, KAPPA = "controller.latency_us", "controller.kappa"
BANDWIDTH, RADIUS = "actuator.bandwidth_hz", "sphere.radius_m"
FORCE, PUSH = "contact_force", "actuator_force"


def scene(*changes: str, law: str = "slope_threshold") -> Setup:
    return load("aluminium-3mm", [f"controller.law={law}", *changes])


def record(
    setup: Setup,
    quantity: str = FORCE,
    duration_s: float = 90e-6,
    seed: int = 3,
    phase: float = 0.3,
    clock: str = "",
    **table: object,
) -> Record:
    seen = truth(setup, quantity, duration_s, accuracy=1e-4, phase=phase)
    said = Measurement(quantity=quantity, **table)
    return measured(
        seen, Spoilt(gain=1.01, offset=0.01), seed, table=said, zero_s=0.002, clock=clock
    )


def holds(found: FitResult, **true: float) -> bool:
    return all(
        (e.low or 0.0) <= true[name] <= (e.high or np.inf)
        for e in found.estimates
        if (name := e.key.partition(".")[2]) in true
    )


@pytest.mark.parametrize(
    "changes",
    [
        (),
        pytest.param(("actuator.bandwidth_hz=5e4",), marks=pytest.mark.full),
        ("sensors.every_steps=3", "controller.latency_us=6"),
    ],
)
def test_the_loop_of_a_fit_converges_and_touches_at_time_zero(changes):
    setup = scene(*changes)
    coarse, fine = LoopSimulator(setup, 90e-6, 1e-4), LoopSimulator(setup, 90e-6, 1e-4, 50)
    time_s = np.arange(0.0, 85e-6, 0.17e-6)
    for phase in (0.0, 0.4, 0.9 * setup.sensor.every_steps):
        one, other = coarse.run({}, 90e-6, phase), fine.run({}, 90e-6, phase)
        assert abs(float(other.value("xi", np.array([0.0]))[0])) < 1e-12
        for quantity in (FORCE, PUSH):
            true = other.value(quantity, time_s)
            off = one.value(quantity, time_s) - true
            assert np.sqrt(np.mean(off**2)) < 1e-4 * np.max(np.abs(true))
    again = coarse.run({}, 90e-6, 0.4 + setup.sensor.every_steps)
    assert np.array_equal(again.truth, coarse.run({}, 90e-6, 0.4).truth)


def test_the_loop_of_a_fit_has_the_force_of_a_run():
    """With one step of the plant in each of the scene, it is the loop of a run."""
    from hertzloop.loop.simulate import simulate

    setup = scene(
        "controller.latency_us=4",
        "run.plate_model=modal",
        "run.accuracy=1e-4",
        "run.duration_s=2e-4",
        "run.lead_in_s=1e-4",
        "run.touch_phase=0.3",
    )
    run = simulate(setup).truth
    ours = LoopSimulator(setup, 90e-6, 1e-4, 1000).run({}, 90e-6, 0.3).truth
    first, other = (int(np.flatnonzero(rows[0] <= 0.0)[0]) for rows in (run, ours))
    np.testing.assert_allclose(
        ours[5, other : other + 85], run[5, first : first + 85], rtol=1e-3, atol=1e-3
    )


def test_the_latency_of_a_loop_is_found_with_an_interval():
    found = fitted(scene(), [record(scene(f"{LATENCY}=6"))], LATENCY)
    [estimate] = found.estimates
    assert holds(found, latency_us=6.0)
    assert estimate.verdict is KeyVerdict.IDENTIFIED
    assert estimate.value % 1.0 == 0.0
    assert found.model is ModelVerdict.FITS
    assert found.setup.latency_us == estimate.value
    assert any("simulated under the law 'slope_threshold'" in note for note in found.notes)


@pytest.mark.full
def test_latency_and_gain_of_a_velocity_feedback():
    true = scene(f"{LATENCY}=3", f"{KAPPA}=0.5", f"{BANDWIDTH}=1e5", law="velocity_feedback")
    start = true.vary({LATENCY: 5.0, KAPPA: 0.4})
    found = fitted(start, [record(true, "v_p", 150e-6)], LATENCY, KAPPA)
    assert holds(found, latency_us=3.0, kappa=0.5)
    assert all(e.verdict is KeyVerdict.IDENTIFIED for e in found.estimates)
    assert found.covariance.shape == (2, 2)


@pytest.mark.full
def test_the_force_of_the_actuator_tells_its_bandwidth_and_a_wrong_gain_does_not_fit():
    true = scene(f"{LATENCY}=4", f"{BANDWIDTH}=4e4")
    one = record(true, PUSH, 150e-6)
    found = fitted(true.vary({BANDWIDTH: 5e4}), [one], BANDWIDTH)
    assert holds(found, bandwidth_hz=4e4)
    assert found.model is ModelVerdict.FITS
    wrong = fitted(true.vary({KAPPA: 0.5, BANDWIDTH: 5e4}), [one], BANDWIDTH)
    assert wrong.model is ModelVerdict.DOES_NOT_FIT


@pytest.mark.full
def test_the_latency_needs_the_touch_in_the_same_time():
    """A force that comes after the contact has any latency, as its record begins at any time."""
    true = scene(f"{LATENCY}=40", f"{BANDWIDTH}=4e4")
    push = record(true, PUSH, 130e-6, clock="daq")
    asked = [parse_free_key(true, f"{LATENCY}=37:43")]
    [alone] = check(true, [push], asked).estimates
    assert alone.verdict is KeyVerdict.NOT_IDENTIFIABLE
    both = [record(true, duration_s=130e-6, seed=4, clock="daq"), push]
    found = fit(true.vary({LATENCY: 38.0}), both, asked)
    assert holds(found, latency_us=40.0)
    assert found.estimates[0].verdict is KeyVerdict.IDENTIFIED
    first, second = found.nuisances
    assert first.time_shift_s == second.time_shift_s


def test_converters_of_the_loop_do_not_spoil_the_derivatives():
    true = scene("sensors.bits=12", f"{LATENCY}=5", "sensors.noise_rms=1e-9")
    found = fitted(true.vary({KAPPA: 0.7}), [record(true)], KAPPA)
    assert found.estimates[0].value == pytest.approx(0.8, rel=0.02)
    assert any("sensors.noise_rms" in note for note in found.notes)


@pytest.mark.parametrize(("changes", "table", "keys", "words"), [
    (("controller.v_thr_m_s=100",), {}, (KAPPA,), "kappa: not identifiable, as the actuator never"),
    (("controller.jitter_us=2",), {}, (LATENCY,), "jitter_us = 2.0: a fit simulates one run"),
    ((), {}, (LATENCY, "actuator.dead_time_us"), "finds one key in whole steps"),
    ((), {"control": False}, (LATENCY,), "Give a record of an impact under the law"),
    ((), {"quantity": "v_p", "point_m": (0.1, 0.1)}, (LATENCY,), "must be of the contact point"),
])  # fmt: skip
def test_what_cannot_be_identified_is_refused(changes, table, keys, words):
    one = record(scene(f"{LATENCY}=6"))
    measurement = replace(one.measurement, **table)
    one = replace(one, quantity=table.get("quantity", one.quantity), measurement=measurement)
    with pytest.raises((FitError, RecordError), match=words):
        fitted(scene(*changes), [one], *keys)


def test_a_force_that_jumps_needs_a_bandwidth():
    setup, behind = scene(f"{LATENCY}=6"), scene(f"{LATENCY}=6", f"{BANDWIDTH}=5e4")
    push = record(behind, PUSH)
    for start, one, key, words in (
        (setup, push, KAPPA, "jumps at every step, which no sensor shows"),
        (setup, record(behind, "v_p"), KAPPA, "v_p that is recorded jumps"),
        (setup.without_control(), push, RADIUS, "law = off: a record is under control"),
        (behind, record(behind, PUSH, control=False), KAPPA, "holds the force of the actuator"),
    ):
        with pytest.raises(RecordError, match=words):
            fitted(start, [one], key)
