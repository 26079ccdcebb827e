"""Estimates, intervals and verdicts on synthetic records whose truth is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.fitting.fit.check import check, expected_record
from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.free_keys import parse_free_key
from hertzloop.fitting.fit.impact_simulator import ImpactSimulator
from hertzloop.fitting.fit.results import KeyVerdict, ModelVerdict
from hertzloop.fitting.fit.simulated_impact import MeasuringChain, observe
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.reading import read_records
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import load
from tests.commands import invoke
from tests.fitting.fitting import (
    HEIGHT,
    PRESSURE,
    RADIUS,
    THICKNESS,
    YIELDS,
    assert_holds,
    fitted,
    record,
    scene,
)


def test_a_wrong_class_of_models_is_flagged():
    found = fitted(scene(), record(scene(*YIELDS)), HEIGHT, "contact.stiffness_factor")
    assert found.model is ModelVerdict.DOES_NOT_FIT
    assert found.residual_over_noise > 2.0
    assert found.statistics["f_test_p"] < 1e-6


def test_an_elastic_truth_leaves_the_limiting_pressure_open_above():
    found = fitted(scene(*YIELDS), record(scene()), PRESSURE)
    [estimate] = found.estimates
    assert (estimate.verdict, estimate.high) == (KeyVerdict.ONE_SIDED, None)
    assert 1.4e9 < estimate.low < 1.95e9  # the centre pressure of this impact is 1.9 GPa
    assert found.model is ModelVerdict.FITS


def test_a_limiting_pressure_is_found_from_a_start_at_which_nothing_yields():
    """There chi-square has no gradient."""
    start = scene(YIELDS[0], f"{PRESSURE}=2.5e9")
    found = fitted(start, record(scene(*YIELDS), seed=1), PRESSURE, HEIGHT)
    assert_holds(found, 8e8, 0.05)


def test_a_key_that_starts_at_its_bound_is_found():
    start = scene(f"{HEIGHT}=0.02", "contact.stiffness_factor=0.1")
    found = fitted(start, record(scene()), f"{HEIGHT}=0.02:1", "contact.stiffness_factor=0.01:100")
    assert_holds(found, 0.05, 1.0)
    assert found.model is ModelVerdict.FITS


def test_noise_does_not_make_an_elastic_contact_yield():
    """In these three of 110 records the noise looks like yielding at the highest pressure."""
    seen = truth(scene(), "contact_force", 70e-6)
    start = scene(YIELDS[0], f"{PRESSURE}=2.5e9")
    for seed in (87, 98, 107):
        one = measured(seen, Spoilt(noise=0.01), seed, rate_hz=1e6)
        [estimate] = fitted(start, one, PRESSURE).estimates
        assert estimate.high is None, seed


@pytest.mark.parametrize(
    "keys",
    [
        ("sphere.material.young_pa", "contact.stiffness_factor"),
        ("plate.material.density_kg_m3", "plate.thickness_m"),
        ("plate.loss_factor",),
    ],
)
def test_keys_that_a_force_cannot_tell_apart_are_refused_by_name(keys):
    found = fitted(scene(*YIELDS), record(scene(*YIELDS)), *keys)
    assert not found.identifiable
    assert {e.verdict for e in found.estimates} == {KeyVerdict.NOT_IDENTIFIABLE}
    assert found.model is ModelVerdict.FITS


def test_a_check_before_the_experiment_says_what_will_be_known():
    setup = scene(*YIELDS)
    supposed = expected_record(setup, "contact_force:80us:0.3%:2MHz")
    before = check(setup, [supposed], [parse_free_key(setup, key) for key in (PRESSURE, HEIGHT)])
    after = fitted(setup, record(setup), PRESSURE, HEIGHT)
    for one, other in zip(before.estimates, after.estimates, strict=True):
        assert one.half_width_percent == pytest.approx(other.half_width_percent, rel=0.2)


def test_every_key_that_a_record_cannot_tell_is_named():
    """Without a bound on the loss factor, a force leaves the thickness open as well."""
    from hertzloop.fitting.fit.report import sentences

    setup = scene(*YIELDS)
    supposed = expected_record(setup, "contact_force:80us:0.4%")
    keys = (PRESSURE, THICKNESS, "plate.loss_factor")
    found = check(setup, [supposed], [parse_free_key(setup, key) for key in keys])
    assert [e.verdict for e in found.estimates] == [
        KeyVerdict.IDENTIFIED,
        KeyVerdict.NOT_IDENTIFIABLE,
        KeyVerdict.NOT_IDENTIFIABLE,
    ]
    said = sentences(found)
    assert "Not identifiable from these records: plate.thickness_m, plate.loss_factor." in said


def test_a_prior_that_is_wrong_is_reported_as_pulled():
    one = record(scene())
    start = scene("sphere.radius_m=0.0033")
    found = fit(start, [one], [parse_free_key(start, "sphere.radius_m±0.5%")], exact=True)
    assert abs(found.statistics["prior_pulls_sigma"][RADIUS]) > 3.0
    assert found.model is ModelVerdict.DOES_NOT_FIT


def test_several_records_share_the_keys():
    low, high = scene(*YIELDS), scene(*YIELDS, f"{HEIGHT}=0.1")
    table = Measurement(quantity="contact_force", set={HEIGHT: 0.1})
    other = replace(record(high, seed=6), name="higher", measurement=table)
    found = fitted(low, [record(low, seed=5), other], PRESSURE, RADIUS)
    assert [n.record for n in found.nuisances] == ["synthetic", "higher"]
    assert found.model is ModelVerdict.FITS
    speeds = math.sqrt(2 * 9.81 * 0.05), math.sqrt(2 * 9.81 * 0.1)
    assert found.speeds_m_s == pytest.approx(speeds)
    assert_holds(found, 8e8, 0.003)


def test_channels_of_one_file_are_fitted_together(tmp_path):
    """Force in kN and velocity in mm/s, each with its own gain and noise, share keys and touch."""
    setup = scene()
    parts = [record(setup, gain=1.02, offset=0.02), record(setup, "v_p", noise=0.01)]
    columns = [parts[0].time_s, 1e-3 * parts[0].value, 1e3 * parts[1].value]
    drop = tmp_path / "drop.csv"
    header = "time_s,one [kN],two [mm/s]"
    np.savetxt(drop, np.stack(columns, 1), "%.12g", delimiter=",", header=header, comments="")
    tables = 'quantity = "contact_force"\ncolumn = "one [kN]"', 'quantity = "v_p"\ncolumn = 3'
    text = "\n".join(f"[[record]]\n{table}\n" for table in tables)
    drop.with_suffix(".toml").write_text(text)
    several = read_records(drop)
    found = fitted(setup, several, RADIUS)
    assert found.model is ModelVerdict.FITS
    one, other = found.nuisances
    assert [one.record, other.record] == ["drop.csv, contact_force", "drop.csv, v_p"]
    assert one.time_shift_s == other.time_shift_s
    assert one.offset == pytest.approx(0.02 * np.max(parts[0].value), rel=0.2)
    assert (one.gain, other.gain) == (pytest.approx(1.02, abs=0.01), pytest.approx(1, abs=0.01))
    shows = invoke(["fit", "--check", str(drop)])
    assert shows.output.count(f"{len(several[0].value)} samples") == 2


@pytest.mark.full
def test_a_hold_out_at_another_height_finds_the_wrong_class():
    """A stiffness can stand in for yielding at one height, not at two."""
    one = record(scene(*YIELDS), noise=0.05)
    other = replace(
        record(scene(*YIELDS, f"{HEIGHT}=0.2"), noise=0.005),
        name="higher",
        measurement=Measurement(quantity="contact_force", set={HEIGHT: 0.2}),
    )
    for fits, setup, key in (
        (True, scene(*YIELDS), PRESSURE),
        (False, scene(), "contact.stiffness_factor"),
    ):
        found = fit(setup, [one], [parse_free_key(setup, key)], [other])
        assert (found.hold_out["residual_over_noise"] < 1.5) == fits


def test_a_second_impact_is_part_of_the_simulation():
    """The 20 mm ball does not leave the plate at once: it hits it again 1.6 ms later."""
    setup = load("aluminium-20mm", ["controller.law=off"])
    seen = truth(setup, "contact_force", 2.2e-3, accuracy=1e-4)
    one = measured(seen, Spoilt(), 4, rate_hz=5e5, quiet_s=600e-6)
    assert fitted(setup, one, THICKNESS).estimates[0].value == pytest.approx(0.003, rel=1e-3)


@pytest.mark.full
def test_a_plate_is_fitted_by_its_motion_beside_the_contact():
    point, duration_s = (0.3, 0.27), 5e-4
    simulator = ImpactSimulator(scene(), duration_s, 1e-4, point, step_ns=125)
    tau = np.arange(-2.5e-4, duration_s - 1e-5, 1e-6)
    value = observe(simulator.run({}, duration_s), "v_p", MeasuringChain(), True).value(tau)
    # Waves of 200 kHz run 54 mm in about 20 us: nothing moves there at once.
    early = (tau > 0.0) & (tau < 8e-6)
    assert np.max(np.abs(value[early])) < 0.05 * np.max(np.abs(value))
    noise = 0.003 * np.max(np.abs(value)) * np.random.default_rng(1).standard_normal(len(tau))
    one = Record("beside", tau, value + noise, "v_p", {"point_m": point})
    found = fitted(scene("plate.thickness_m=0.0032"), one, THICKNESS)
    assert_holds(found, 0.003)
    assert found.nuisances[0].time_shift_s == pytest.approx(0.0, abs=1e-7)
