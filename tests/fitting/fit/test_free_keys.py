"""Keys that a fit frees: their text, ranges and priors."""

from collections.abc import Iterable
from dataclasses import replace

import pytest

from hertzloop.fitting.errors import FitError, RecordError
from hertzloop.fitting.fit.free_keys import parse_free_key
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.scene.setup import Setup, load
from tests.fitting.fitting import HEIGHT, PRESSURE, RADIUS, fitted, record, scene

LATENCY = "controller.latency_us"


def refused(setup: Setup, cases: Iterable[tuple[str, str]]) -> None:
    """Each text is refused with its words."""
    for text, words in cases:
        with pytest.raises(FitError, match=words):
            parse_free_key(setup, text)


def test_free_keys_are_read_from_their_text():
    setup = scene()
    one = parse_free_key(setup, "sphere.drop_height_m=0.04:0.06±2%")
    assert (one.low, one.high, one.prior) == (0.04, 0.06, 0.02)
    assert parse_free_key(setup, "sphere.drop_height_m+-0.001").prior == pytest.approx(0.02)
    refused(
        setup,
        (
            ("plate.size_m", "one positive number"),
            (PRESSURE, "does not yield"),
            ("contact.restitution", "no effect without contact.damping = 'hunt_crossley'"),
            ("controller.latency_us", "law is off.*without control.*--set controller.law"),
            ("actuator.bandwidth_hz", "law is off.*without control"),
            ("run.duration_s", "choice of the simulation"),
            ("sensors.noise_rms", "low_pass_hz"),
            ("sphere.radius_m=2:1", "rise"),
            (
                "sphere.radius_m=1e-7:0.01",
                "sphere.radius_m = 1e-07: is not possible. Possible values: 1e-5",
            ),
            ("plate.loss_factor=0.1:2", "plate.loss_factor = 2.*0 to 1"),
        ),
    )


def test_free_keys_of_a_law_are_read_from_their_text():
    setup = load("aluminium-3mm", [f"{LATENCY}=2"])
    one = parse_free_key(setup, LATENCY)
    assert (one.low, one.high, one.resolution) == (0.0, 20.0, 1.0)
    assert parse_free_key(setup, f"{LATENCY}=0:40").start == 2.0
    assert parse_free_key(setup, "actuator.dead_time_us").start == 0.0
    assert parse_free_key(setup, "controller.kappa±5%").prior == pytest.approx(0.05)
    refused(
        setup,
        (
            (f"{LATENCY}±1", "has no prior"),
            ("controller.jitter_us", "one run cannot tell"),
            ("controller.v_thr_m_s", "one positive number"),
            ("controller.kapa", "Did you mean controller.kappa"),
            ("actuator.stuck_from_s", "of the actuator only"),
        ),
    )


def test_a_default_range_ends_where_the_scene_does():
    wide = parse_free_key(scene("sphere.drop_height_m=50.0"), HEIGHT)
    assert (wide.low, wide.high) == (10.0, pytest.approx(100.0, rel=1e-5))
    assert wide.high <= 100.0


def test_a_key_that_is_free_twice_is_refused():
    with pytest.raises(FitError, match="given twice"):
        fitted(scene(), record(scene()), RADIUS, RADIUS)


def test_a_key_that_every_record_holds_and_a_point_off_the_plate_are_refused():
    one = record(scene())
    held = replace(one, measurement=Measurement(set={RADIUS: 0.004}))
    with pytest.raises(FitError, match=f"--free {RADIUS}: record.set holds it in synthetic"):
        fitted(scene(), held, RADIUS)
    beside = replace(one, quantity="v_p", measurement=Measurement(point_m=(9.0, 9.0)))
    with pytest.raises(RecordError, match=r"record.point_m = \[9.0, 9.0\]: is not a point of"):
        fitted(scene(), beside, RADIUS)


def test_a_latency_starts_within_its_range():
    free = parse_free_key(load("aluminium-3mm"), "controller.latency_us=90:100")
    assert free.start == 95.0
