"""`hertzloop fit`: estimates, intervals, verdicts on synthetic records whose truth is known."""

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.identification.fit.check import check
from hertzloop.identification.fit.errors import FitError
from hertzloop.identification.fit.expected_record import expected_record
from hertzloop.identification.fit.fit import fit
from hertzloop.identification.fit.free_keys import parse_free_key
from hertzloop.identification.fit.model import FrozenModel
from hertzloop.identification.fit.observation import MeasuringChain, observe
from hertzloop.identification.fit.prepare import prepare_problem
from hertzloop.identification.fit.results import FitResult
from hertzloop.identification.fit.verdicts import KeyVerdict, ModelVerdict
from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.measurement import Measurement
from hertzloop.identification.records.reading import read_record, read_records
from hertzloop.identification.records.record import Record
from hertzloop.plant.structures import edged_plate
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from tests.commands import invoke
from tests.identification.drops import Drop

YIELDS = ("contact.plasticity=thornton", "contact.limiting_pressure_pa=8e8")
PRESSURE, HEIGHT = "contact.limiting_pressure_pa", "sphere.drop_height_m"
RADIUS, THICKNESS = "sphere.radius_m", "plate.thickness_m"


def scene(*changes: str) -> Setup:
    return load("aluminium-3mm", ["controller.law=off", *changes])


def record(setup: Setup, quantity: str = "contact_force", duration_s: float = 80e-6,
           seed: int = 3, **spoilt: float) -> Record:  # fmt: skip
    seen = truth(setup, quantity, duration_s, accuracy=1e-4)
    return measured(seen, Spoilt(**spoilt), seed)  # type: ignore[arg-type]


def fitted(setup: Setup, one: Record, *keys: str) -> FitResult:
    return fit(setup, [one], [parse_free_key(setup, key) for key in keys])


def test_intervals_hold_the_truth_and_the_model_fits() -> None:
    one = record(scene(*YIELDS), gain=1.01, offset=0.02)
    start = scene(YIELDS[0], "contact.limiting_pressure_pa=1.1e9")
    found = fitted(start, one, PRESSURE, HEIGHT)
    for estimate, true, widest in zip(found.estimates, (8e8, 0.05), (1.0, 5.0), strict=True):
        assert estimate.low is not None
        assert estimate.high is not None
        assert estimate.low < true < estimate.high
        assert estimate.half_width_percent is not None
        assert estimate.half_width_percent < widest
        assert estimate.verdict is KeyVerdict.IDENTIFIED
    assert found.model is ModelVerdict.FITS
    assert found.residual_over_noise == pytest.approx(1.0, abs=0.15)
    [nuisance] = found.nuisances
    assert nuisance.gain == pytest.approx(1.01, abs=0.03)
    assert nuisance.offset == pytest.approx(0.02 * 60.0, rel=0.2)


def test_a_start_20_percent_off_is_found_by_growing_windows() -> None:
    one = record(scene(*YIELDS), "v_p", 1e-3)
    found = fitted(scene(*YIELDS, "plate.thickness_m=0.0036"), one, THICKNESS)
    [estimate] = found.estimates
    assert estimate.low is not None
    assert estimate.high is not None
    assert estimate.low < 0.003 < estimate.high


def test_a_wrong_class_of_models_is_flagged() -> None:
    one = record(scene(*YIELDS))
    found = fitted(scene(), one, HEIGHT, "contact.stiffness_factor")
    assert found.model is ModelVerdict.DOES_NOT_FIT
    assert found.residual_over_noise > 2.0
    assert found.statistics["f_test_p"] < 1e-6


def test_an_elastic_truth_leaves_the_limiting_pressure_open_above() -> None:
    found = fitted(scene(*YIELDS), record(scene()), PRESSURE)
    [estimate] = found.estimates
    assert estimate.verdict is KeyVerdict.ONE_SIDED
    assert estimate.high is None
    assert estimate.low is not None
    assert 1.4e9 < estimate.low < 1.95e9  # the centre pressure of this impact is 1.9 GPa
    assert found.model is ModelVerdict.FITS


def test_noise_does_not_make_an_elastic_contact_yield() -> None:
    """In these three of 110 records the noise looks like yielding at the highest pressure."""
    seen = truth(scene(), "contact_force", 70e-6)
    start = scene(YIELDS[0], f"{PRESSURE}=2.5e9")
    for seed in (87, 98, 107):
        one = measured(seen, Spoilt(noise=0.01), seed, rate_hz=1e6)
        [estimate] = fitted(start, one, PRESSURE).estimates
        assert estimate.high is None, seed


@pytest.mark.full
def test_steps_of_a_converter_above_the_noise_do_not_refuse_the_right_class() -> None:
    """The baseline rests on one level, away from the offset; the contact shows all of the noise."""
    seen = truth(scene(), "contact_force", 70e-6)
    inside = fits = 0
    for seed in range(20):
        step = 2.5 / 2**8
        one = measured(seen, Spoilt(noise=0.25 * step, bits=8, offset=0.45 * step), seed)
        found = fitted(scene(), one, RADIUS)
        [estimate] = found.estimates
        assert estimate.low is not None
        assert estimate.high is not None
        inside += estimate.low < 0.003 < estimate.high
        fits += found.model is ModelVerdict.FITS
    assert inside >= 17
    assert fits >= 18


@pytest.mark.parametrize("keys", [
    ("sphere.material.young_pa", "contact.stiffness_factor"),
    ("plate.material.density_kg_m3", "plate.thickness_m"),
    ("plate.loss_factor",),
])  # fmt: skip
def test_keys_that_a_force_cannot_tell_apart_are_refused_by_name(keys: tuple[str, ...]) -> None:
    found = fitted(scene(*YIELDS), record(scene(*YIELDS)), *keys)
    assert not found.identifiable
    assert {e.verdict for e in found.estimates} == {KeyVerdict.NOT_IDENTIFIABLE}
    if len(keys) > 1:
        assert set(found.combinations[0].exponents) == set(keys)
    assert found.model is ModelVerdict.FITS


def test_a_check_before_the_experiment_says_what_will_be_known() -> None:
    setup = scene(*YIELDS)
    supposed = expected_record(setup, "contact_force:80us:0.3%:2MHz")
    keys = [parse_free_key(setup, key) for key in (PRESSURE, HEIGHT)]
    before = check(setup, [supposed], keys)
    after = fitted(setup, record(setup), PRESSURE, HEIGHT)
    for one, other in zip(before.estimates, after.estimates, strict=True):
        assert one.half_width_percent == pytest.approx(other.half_width_percent, rel=0.2)


def test_every_key_that_a_record_cannot_tell_is_named() -> None:
    """Without a bound on the loss factor, a force leaves the thickness open as well."""
    from hertzloop.identification.fit.report import sentences

    setup = scene(*YIELDS)
    supposed = expected_record(setup, "contact_force:80us:0.4%")
    keys = (PRESSURE, THICKNESS, "plate.loss_factor")
    found = check(setup, [supposed], [parse_free_key(setup, key) for key in keys])
    assert [e.verdict for e in found.estimates] == [
        KeyVerdict.IDENTIFIED, KeyVerdict.NOT_IDENTIFIABLE, KeyVerdict.NOT_IDENTIFIABLE,
    ]  # fmt: skip
    said = sentences(found)
    assert "Not identifiable from these records: plate.loss_factor; plate.thickness_m." in said
    assert any(s.startswith(f"{THICKNESS}: ") and "other keys are known" in s for s in said)
    assert any(s.startswith("plate.loss_factor: ") and "no useful bound" in s for s in said)
    assert not any(s.startswith(PRESSURE) for s in said)


def test_a_prior_that_is_wrong_is_reported_as_pulled() -> None:
    one = record(scene())
    start = scene("sphere.radius_m=0.0033")
    found = fit(start, [one], [parse_free_key(start, "sphere.radius_m±0.5%")], exact=True)
    assert abs(found.statistics["prior_pulls_sigma"][RADIUS]) > 3.0
    assert found.model is ModelVerdict.DOES_NOT_FIT


@pytest.mark.full
def test_a_clock_that_is_off_does_not_move_the_thickness_out_of_its_interval() -> None:
    one = record(scene(*YIELDS), "v_p", 3e-3, clock_ppm=40.0)
    [estimate] = fitted(scene(*YIELDS), one, THICKNESS).estimates
    assert estimate.low is not None
    assert estimate.high is not None
    assert estimate.low < 0.003 < estimate.high
    # A thickness 1e-4 off is as good as a clock of 50 ppm, which the prior allows.
    assert estimate.half_width_percent == pytest.approx(0.01, rel=0.3)


def test_several_records_share_the_keys() -> None:
    low, high = scene(*YIELDS), scene(*YIELDS, "sphere.drop_height_m=0.1")
    one = record(low, seed=5)
    other = replace(
        record(high, seed=6), name="higher",
        measurement=Measurement(quantity="contact_force", set={HEIGHT: 0.1}),
    )  # fmt: skip
    found = fit(low, [one, other], [parse_free_key(low, PRESSURE), parse_free_key(low, RADIUS)])
    assert [n.record for n in found.nuisances] == ["synthetic", "higher"]
    assert found.model is ModelVerdict.FITS
    assert found.speeds_m_s == pytest.approx(
        (math.sqrt(2 * 9.81 * 0.05), math.sqrt(2 * 9.81 * 0.1))
    )
    for estimate, true in zip(found.estimates, (8e8, 0.003), strict=True):
        assert estimate.low is not None
        assert estimate.high is not None
        assert estimate.low < true < estimate.high


def test_channels_of_one_file_are_fitted_together(tmp_path: Path) -> None:
    """Force in kN and velocity in mm/s, each with its own gain and noise, share keys and touch."""
    setup = scene()
    parts = [record(setup, "contact_force", gain=1.02), record(setup, "v_p", noise=0.01)]
    columns = [parts[0].time_s, 1e-3 * parts[0].value, 1e3 * parts[1].value]
    names = "time_s,one [kN],two [mm/s]"
    np.savetxt(tmp_path / "drop.csv", np.stack(columns, 1), delimiter=",", header=names,
               comments="", fmt="%.12g")  # fmt: skip
    tables = ('quantity = "contact_force"\ncolumn = "one"', 'quantity = "v_p"\ncolumn = 3')
    text = "\n".join(f"[[record]]\n{table}\n" for table in tables)
    (tmp_path / "drop.toml").write_text(text)
    several = read_records(tmp_path / "drop.csv")
    assert [one.name for one in several] == ["drop.csv, contact_force", "drop.csv, v_p"]
    for one, part in zip(several, parts, strict=True):
        np.testing.assert_allclose(one.value, part.value, rtol=1e-9)
        assert one.measurement.clock == "drop.csv"
    with pytest.raises(RecordError, match="holds 2 records"):
        read_record(tmp_path / "drop.csv")
    found = fit(setup, several, [parse_free_key(setup, RADIUS)])
    assert found.model is ModelVerdict.FITS
    one, other = found.nuisances
    assert one.time_shift_s == other.time_shift_s
    assert (one.gain, other.gain) == (pytest.approx(1.02, abs=0.01), pytest.approx(1, abs=0.01))
    alone = "".join(f"[[record]]\nfile = 'drop.csv'\n{table}\n" for table in tables)
    (tmp_path / "drop.toml").unlink()
    (tmp_path / "rig.toml").write_text(alone)
    assert [one.sha256 for one in read_records(tmp_path / "rig.toml")] == (
        [one.sha256 for one in several]
    )
    (tmp_path / "drop.csv").write_text(
        "".join(f"# {line}\n" for line in text.splitlines()) + (tmp_path / "drop.csv").read_text()
    )
    for name in ("drop.csv", "rig.toml"):
        shows = invoke(["fit", "--check", str(tmp_path / name)])
        assert shows.output.count(f"{len(several[0].value)} samples") == 2


def test_a_hold_out_at_another_height_finds_the_wrong_class() -> None:
    """A stiffness can stand in for yielding at one height, not at two."""
    one = record(scene(*YIELDS), noise=0.05)
    other = replace(
        record(scene(*YIELDS, "sphere.drop_height_m=0.2"), noise=0.005), name="higher",
        measurement=Measurement(quantity="contact_force", set={HEIGHT: 0.2}),
    )  # fmt: skip
    for fits, setup, key in ((True, scene(*YIELDS), PRESSURE),
                             (False, scene(), "contact.stiffness_factor")):  # fmt: skip
        found = fit(setup, [one], [parse_free_key(setup, key)], [other])
        assert found.hold_out is not None
        assert (found.hold_out["residual_over_noise"] < 1.5) == fits


# Bad records: a sentence each, or a right answer.


def test_a_record_that_is_no_table_is_refused(tmp_path: Path) -> None:
    for text in ("record = 3", "record = [1, 2]"):
        (tmp_path / "rig.toml").write_text(text)
        with pytest.raises(RecordError, match=r"rig\.toml: .* is not a table. Write \[record\]"):
            read_records(tmp_path / "rig.toml")


def changed(one: Record, value: np.ndarray, time_s: np.ndarray | None = None) -> Record:
    return replace(one, value=value, time_s=one.time_s if time_s is None else time_s)


@pytest.mark.parametrize("scale", [1e9, 1e6, 1e3, 1e-3, 1e-9])
def test_times_in_another_unit_are_refused_at_once(scale: float) -> None:
    """A search over such an axis took minutes of CPU time, or 90 GiB."""
    one = record(scene())
    with pytest.raises(RecordError, match="that time_s is in seconds"):
        fitted(scene(), changed(one, one.value, scale * one.time_s), RADIUS)


def test_a_sparse_start_does_not_widen_the_search() -> None:
    one = record(scene())
    sparse = np.arange(-2000.0, 0.0) - 1.0
    quiet = 0.2 * np.random.default_rng(0).standard_normal(len(sparse))
    both = changed(one, np.append(quiet, one.value), np.append(sparse, one.time_s))
    assert fitted(scene(), both, RADIUS).estimates[0].value == pytest.approx(0.003, rel=5e-3)


@pytest.mark.parametrize(("change", "words"), [
    (lambda v: 1000.0 * v, "times the simulation"),
    (lambda v: -v, "opposite sign"),
    (lambda v: 0.2 * np.random.default_rng(1).standard_normal(len(v)), "no impact"),
    (lambda v: np.zeros(len(v)), "with an impact"),
    (lambda v: np.where(v == v.max(), v, np.sin(np.arange(len(v)) ** 2)), "impact is shorter"),
])  # fmt: skip
def test_a_record_that_cannot_be_right_is_refused(change: object, words: str) -> None:
    one = record(scene())
    with pytest.raises(RecordError, match=words):
        fitted(scene(), changed(one, change(one.value)), RADIUS)  # type: ignore[operator]


def test_a_clipped_record_gives_the_right_answer() -> None:
    one = record(scene())
    cut = changed(one, np.minimum(one.value, 60.0))
    found = fitted(scene(), cut, RADIUS)
    [estimate] = found.estimates
    assert estimate.low is not None
    assert estimate.high is not None
    assert estimate.low < 0.003 < estimate.high
    assert any("end of the range" in note for note in found.notes)


def test_samples_that_are_not_numbers_are_left_aside() -> None:
    one = record(scene())
    value = one.value.copy()
    value[100:110] = np.nan
    value[520] = np.nan
    [estimate] = fitted(scene(), changed(one, value), RADIUS).estimates
    assert estimate.value == pytest.approx(0.003, rel=5e-3)


def test_a_record_without_samples_before_the_impact_cannot_tell() -> None:
    one = record(scene())
    late = one.time_s > one.time_s[np.argmax(one.value)] - 12e-6
    cut = changed(one, one.value[late], one.time_s[late])
    found = fitted(scene(), cut, RADIUS)
    assert found.model is ModelVerdict.CANNOT_TELL
    assert found.estimates[0].value == pytest.approx(0.003, rel=1e-2)


def test_a_second_drop_in_a_record_is_named() -> None:
    one = record(scene())
    later = one.time_s[-1] - one.time_s[0] + one.interval_s
    twice = changed(one, np.tile(one.value, 2), np.concatenate([one.time_s, one.time_s + later]))
    found = fitted(scene(), twice, RADIUS)
    assert found.model is ModelVerdict.DOES_NOT_FIT
    assert any("us after the first is not in the simulation" in reason for reason in found.reasons)


def test_a_second_impact_is_part_of_the_simulation() -> None:
    """The 20 mm ball does not leave the plate at once: it hits it again 1.6 ms later."""
    setup = load("aluminium-20mm", ["controller.law=off"])
    one = measured(truth(setup, "contact_force", 2.2e-3, accuracy=1e-4), Spoilt(), 4, rate_hz=5e5,
                   quiet_s=600e-6)  # fmt: skip
    [estimate] = fitted(setup, one, THICKNESS).estimates
    assert estimate.value == pytest.approx(0.003, rel=1e-3)


@pytest.mark.full
def test_ten_million_samples_are_thinned() -> None:
    one = record(scene())
    step = one.interval_s
    more = 10_000_000 - len(one.value)
    value = np.concatenate([one.value, 0.2 * np.random.default_rng(1).standard_normal(more)])
    time_s = np.concatenate([one.time_s, one.time_s[-1] + step * np.arange(1, more + 1)])
    found = fitted(scene(), Record("long", time_s, value, "contact_force"), RADIUS)
    assert found.estimates[0].value == pytest.approx(0.003, rel=5e-3)


def test_a_coarse_record_is_fitted_as_it_was_sampled() -> None:
    """Five samples in a contact: the samples alias nothing if none were averaged."""
    seen = truth(scene(), "contact_force", 80e-6, accuracy=1e-4)
    one = measured(seen, Spoilt(), 3, rate_hz=2e5, quiet_s=2e-3)
    [estimate] = fitted(scene(), one, RADIUS).estimates
    assert estimate.low is not None
    assert estimate.high is not None
    assert estimate.low < 0.003 < estimate.high


# The frozen model and the chain.


def test_the_frozen_model_has_the_same_modes_at_every_value() -> None:
    model = FrozenModel(scene(), 1e-4, 1e-4)
    counts = {
        model.plant_of(model.spec_of({THICKNESS: 0.003 * (1.0 + change)})).model.table.shape
        for change in np.linspace(-1e-3, 1e-3, 9)
    }
    assert len(counts) == 1


def test_a_changed_sphere_has_the_bits_of_a_plant_built_anew() -> None:
    model = FrozenModel(scene(*YIELDS), 1e-4, 1e-4)
    values = {RADIUS: 0.0031, HEIGHT: 0.06, "contact.stiffness_factor": 1.1}
    model.run({}, 1e-4)
    shared = model.run(values, 1e-4)
    fresh = FrozenModel(scene(*YIELDS), 1e-4, 1e-4).run(values, 1e-4)
    assert np.array_equal(shared.truth, fresh.truth)


def test_the_chain_agrees_with_the_sensor_of_a_run() -> None:
    """Both take straight lines, the scene's sensor between steps, the chain on a finer grid."""
    from hertzloop.loop.simulate import simulate

    changes = (
        "sensors.quantity=v_p", "sensors.low_pass_hz=80e3", "sensors.ac_coupling_hz=2e3",
        "sensors.resonance_hz=150e3", "sensors.resonance_damping=0.1", "run.step_ns=100",
        "sensors.low_pass_order=4",
        "run.duration_s=3e-4", "run.lead_in_s=1e-4", "run.plate_model=modal", "run.accuracy=1e-4",
    )  # fmt: skip
    setup = scene(*changes)
    values = simulate(setup).values
    # The touch lies in the middle of a step.
    time_s = 100e-9 * (np.arange(len(values)) - 0.5) - 1e-4
    model = FrozenModel(setup, 2.5e-4, 1e-4)
    chain = MeasuringChain(150e3, 0.1, 2e3, 80e3, low_pass_order=4)
    seen = observe(model.run({}, 2.5e-4), "v_p", chain, False).value(time_s)
    inside = time_s < 1.9e-4
    peak = np.max(np.abs(values))
    assert np.max(np.abs(seen - values)[inside]) < 2e-4 * peak


def test_stiffness_factor_is_a_factor_on_the_contact() -> None:
    plain, twice = scene(), scene("contact.stiffness_factor=2.0")
    assert twice.contact.stiffness == 2.0 * plain.contact.stiffness


# Files and the command.


def test_units_and_table_of_a_csv_file(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    rows = "\n".join(f"{i * 1e-6:.9g},{i % 5}" for i in range(20))
    path.write_text(f"time_s,v_p_mm_s\n{rows}\n")
    one = read_record(path)
    assert one.quantity == "v_p"
    assert one.value[3] == pytest.approx(3e-3)
    (tmp_path / "r.toml").write_text("[record]\nsensitivity = 10.0\nclock_tolerance_ppm = 5\n")
    one = read_record(path)
    assert one.value[3] == pytest.approx(3e-4)
    assert one.measurement.clock_tolerance_ppm == 5
    (tmp_path / "r.toml").write_text("[record]\nsensitvity = 10.0\n")
    with pytest.raises(RecordError, match="sensitvity"):
        read_record(path)


@pytest.mark.parametrize(("text", "words"), [
    ("", "no samples"),
    ("time_s,contact_force_n\n", "no samples"),
    ("time_s,what\n0,1\n1,2\n", "known quantity"),
    ("contact_force_n\n" + "1\n" * 20, "rate_hz"),
    ("time_s,contact_force_n\n" + "1,1\n" * 20, "rise.*sample 2 at 1 s follows sample 1"),
    ("zeit,contact_force_n\n" + "1,1\n" * 20, "no column time_s; the columns are zeit"),
    ("time_s,contact_force_n\n" + "0,1,1,5\n" * 20, "decimal commas"),
    ("0,1\n" * 20, "two whole numbers or one with a decimal comma"),
])  # fmt: skip
def test_files_that_are_no_records(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "r.csv"
    path.write_text(text)
    with pytest.raises(RecordError, match=words):
        read_record(path)


@pytest.mark.parametrize(("text", "rows"), [
    ("time_s;contact_force_n\n", "{t};{v}"),
    ("time_s;contact_force_n\n", "{t};{v}|.|,"),
    ("time_s\tcontact_force_n\n", "{t}\t{v}|.|,"),
    ("time_s contact_force_n\n", "{t} {v}"),
    ("time_s,contact_force_n\ns,N\n", "{t},{v}"),
    ("Time [s],Force [N]\n", "{t},{v}"),
    ("Time,Force\n(us),(kN)\n", "{us},{kn}"),
    ("Time;Force\nns;N\n\n", "{ns};{v}"),
    ('"time_s","contact_force_n"\n', '"{t}","{v}"'),
])  # fmt: skip
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_tables_as_other_programs_write_them(
    tmp_path: Path, text: str, rows: str, encoding: str
) -> None:
    row, _, changes = rows.partition("|")
    old, _, new = changes.partition("|")
    lines = [row.format(t=1e-6 * i, us=i, ns=1000 * i, v=i % 5 + 0.5, kn=0.001 * (i % 5 + 0.5))
             for i in range(20)]  # fmt: skip
    if new:
        lines = [line.replace(old, new) for line in lines]
    (tmp_path / "r.csv").write_text(text + "\n".join(lines), encoding=encoding)
    one = read_record(tmp_path / "r.csv")
    np.testing.assert_allclose(one.time_s, 1e-6 * np.arange(20), rtol=1e-12)
    assert one.value[3] == pytest.approx(3.5, rel=1e-12)


def test_units_of_time_and_names_in_another_alphabet(tmp_path: Path) -> None:
    rows = "\n".join(f"{i};{i % 5}" for i in range(20))
    (tmp_path / "r.csv").write_text(f"Time (\u00b5s);Velocity [mm/s]\n{rows}\n", "cp1252")
    one = read_record(tmp_path / "r.csv")
    np.testing.assert_allclose(one.time_s, 1e-6 * np.arange(20), rtol=1e-12)
    assert (one.quantity, one.value[3]) == ("v_p", pytest.approx(3e-3))


def test_a_second_column_that_could_be_the_record_is_named(tmp_path: Path) -> None:
    rows = "\n".join(f"{1e-6 * i},{i % 5},{i % 3}" for i in range(20))
    (tmp_path / "r.csv").write_text(f"time_s,contact_force_n,v_p_m_s\n{rows}\n")
    one = read_record(tmp_path / "r.csv")
    assert one.quantity == "contact_force"
    assert "v_p_m_s is not. Choose with record.column" in one.notes[0]
    assert read_record(tmp_path / "r.csv", {"column": "v_p_m_s"}).quantity == "v_p"


def test_recordings_of_runs_are_records(tmp_path: Path) -> None:
    """The recording says which filters its sensor has; a run under a law needs one."""
    path = tmp_path / "r.mcap"
    run = ["run", "aluminium-3mm", "--set", "run.duration_s=0.0012", "--set", "run.lead_in_s=3e-4",
           "--transport", "inprocess", "--overwrite", "--out", str(path)]  # fmt: skip
    sensor = ["sensors.quantity=v_p", "sensors.low_pass_hz=80e3", "sensors.noise_rms=1e-3",
              "sensors.low_pass=bessel", "sensors.low_pass_order=4",
              "run.accuracy=1e-4", "controller.law=off"]  # fmt: skip
    assert invoke([*run, *(word for key in sensor for word in ("--set", key))]).exit_code == 0
    one = read_record(path)
    found = one.measurement
    filters = found.low_pass_hz, found.low_pass, found.low_pass_order
    assert (one.quantity, *filters) == ("v_p", 80e3, "bessel", 4)
    [estimate] = fitted(scene("sphere.radius_m=0.0031"), one, RADIUS).estimates
    assert estimate.value == pytest.approx(3e-3, rel=5e-3)
    assert invoke(run).exit_code == 0
    under = read_record(path)
    assert under.measurement.control is True
    with pytest.raises(RecordError, match="law = off: a record is under"):
        fitted(scene(), under, RADIUS)


def test_npz_parquet_and_wav_hold_the_same_record(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet
    import scipy.io.wavfile

    time_s, force = np.arange(50) * 1e-5, np.linspace(0.0, 0.98, 50)
    np.savez(tmp_path / "r.npz", time_s=time_s, contact_force_n=force)
    table = pyarrow.table({"time_s": time_s, "contact_force_n": force})
    pyarrow.parquet.write_table(table, tmp_path / "r.parquet")
    scipy.io.wavfile.write(tmp_path / "r.wav", 100_000, force.astype(np.float32))
    for name in ("r.npz", "r.parquet", "r.wav"):
        given = {"quantity": "contact_force"} if name == "r.wav" else {}
        one = read_record(tmp_path / name, given)
        np.testing.assert_allclose(one.value, force, atol=1e-6)
        np.testing.assert_allclose(one.time_s, time_s, atol=1e-12)


@pytest.mark.parametrize("kind", ["M8[ns]", "m8[us]", "time64[us]", "M8[us] in npz", "h5 in us"])
def test_times_of_other_kinds_are_seconds(tmp_path: Path, kind: str) -> None:
    import pyarrow
    import pyarrow.parquet

    micro = np.arange(20) + 1_622_505_599_999_700 * ("M8" in kind)
    force = np.arange(20.0)
    path = tmp_path / f"r.{'npz' if 'npz' in kind else 'h5' if 'h5' in kind else 'parquet'}"
    if path.suffix == ".npz":
        np.savez(path, time=micro.astype("M8[us]"), contact_force_n=force)
    elif path.suffix == ".h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["time"], file["contact_force_n"] = micro, force
            file["time"].attrs["units"] = "us"
    else:
        of_day = pyarrow.array(micro, pyarrow.int64()).cast(pyarrow.time64("us"))
        times = of_day if "time64" in kind else micro.astype("M8[us]" if "M8" in kind else kind)
        table = pyarrow.table({"time": times, "contact_force_n": force})
        pyarrow.parquet.write_table(table, path)
    one = read_record(path)
    np.testing.assert_allclose(one.time_s - one.time_s[0], 1e-6 * np.arange(20), atol=1e-12)


def test_free_keys_are_read_from_their_text() -> None:
    setup = scene()
    one = parse_free_key(setup, "sphere.drop_height_m=0.04:0.06±2%")
    assert (one.low, one.high, one.prior) == (0.04, 0.06, 0.02)
    assert parse_free_key(setup, "sphere.drop_height_m+-0.001").prior == pytest.approx(0.02)
    for text, words in (
        ("plate.size_m", "one positive number"),
        ("plate.thicknes_m", "Did you mean plate.thickness_m"),
        (PRESSURE, "does not yield"),
        ("controller.latency_us", "law is off.*without control.*--set controller.law"),
        ("actuator.bandwidth_hz", "law is off.*without control"),
        ("run.duration_s", "choice of the simulation"), ("sensors.noise_rms", "low_pass_hz"),
        ("sphere.radius_m=2:1", "rise"), ("sphere.radius_m=a:b", "not a range"),
        ("sphere.radius_m±x", "not a prior"), ("=1:2", "names no key"),
        ("sphere.radius_m=1e-7:0.01", "sphere.radius_m = 1e-07: must be at least 1e-05"),
        ("plate.loss_factor=0.1:2", "plate.loss_factor = 2.*at most 1"),
        ("sphere.material.density_kg_m3=1e-3:9000", "density_kg_m3 = 0.001: must be 1 to 1e5"),
    ):  # fmt: skip
        with pytest.raises(FitError, match=words):
            parse_free_key(setup, text)


def test_a_default_range_ends_where_the_scene_does() -> None:
    wide = parse_free_key(scene("sphere.drop_height_m=50.0"), HEIGHT)
    assert (wide.low, wide.high) == (10.0, pytest.approx(100.0, rel=1e-5))
    assert wide.high <= 100.0


@pytest.mark.parametrize(("bounds", "end", "value"), [
    ("0.0032:0.005", "low", 0.0032), ("0.002:0.0029", "high", 0.0029),
    ("0.0032:0.005±50%", "low", 0.0032),
])  # fmt: skip
def test_a_key_at_its_bound_is_not_identified(
    tmp_path: Path, bounds: str, end: str, value: float
) -> None:
    drop, data, page = (tmp_path / name for name in ("drop.csv", "f.json", "f.html"))
    written(drop, record(scene()))
    ended = invoke([
        "fit", "aluminium-3mm", str(drop), "--free", f"{RADIUS}={bounds}", "--json", str(data),
        "--report", str(page), "--out", str(tmp_path / "o.toml"),
    ])  # fmt: skip
    assert ended.exit_code == 1, ended.output
    said = json.loads(data.read_text())
    estimate = said["parameters"][RADIUS]
    assert (estimate["verdict"], estimate[end]) == ("at its bound", None)
    assert estimate["value"] == pytest.approx(value, rel=1e-6)
    assert estimate["high" if end == "low" else "low"] is not None
    assert said["statistics"]["at_bound"] == [RADIUS]
    assert said["model"] == "does not fit"
    assert any(f"{RADIUS} is at a bound of its range, the {end} one" in r for r in said["reasons"])
    for text in (ended.output, page.read_text()):
        assert "identified" not in text


def test_the_command_writes_json_scene_page_and_replay(tmp_path: Path) -> None:
    one = record(scene())
    path = tmp_path / "drop.csv"
    np.savetxt(path, np.stack([one.time_s, one.value], 1), delimiter=",",
               header="time_s,contact_force_n", comments="", fmt="%.12g")  # fmt: skip
    out = {name: tmp_path / name for name in ("f.json", "f.toml", "f.html", "f.rrd")}
    words = ["fit", "aluminium-3mm", str(path), "--free", RADIUS, "--json", str(out["f.json"]),
             "--out", str(out["f.toml"]), "--report", str(out["f.html"]),
             "--replay", str(out["f.rrd"])]  # fmt: skip
    ended = invoke(words)
    assert ended.exit_code == 0, ended.output
    data = json.loads(out["f.json"].read_text())
    low, high = (data["parameters"][RADIUS][end] for end in ("low", "high"))
    assert low < 0.003 < high
    assert data["parameters"][RADIUS]["verdict"] == "identified"
    assert data["model"] == "fits"
    assert {"time_shift_s", "gain", "offset", "clock_ppm"} <= data["nuisances"].keys()
    assert data["hold_out"] is None
    assert data["evaluations"] > 0
    again = load(str(out["f.toml"]))
    assert again.sphere.radius_m == data["parameters"][RADIUS]["value"]
    assert again.scene.fit is not None
    assert again.scene.fit.sha256 == (data["records"][0]["sha256"],)
    page = out["f.html"].read_text()
    for part in ("<svg", "Around the contact", "Whole record", "residual over noise", "contact of",
                 "measured", "simulated", f"--free {RADIUS}", "[fit]", "identified"):  # fmt: skip
        assert part in page, part
    assert out["f.rrd"].stat().st_size > 1000


_PAGE = Path(__file__).parents[2] / "docs" / "reference" / "fit-json.md"
_TYPES: dict[str, Callable[[Any], bool]] = {
    "text": lambda v: isinstance(v, str),
    "integer": lambda v: type(v) is int,
    "number": lambda v: type(v) in (int, float),
    "number or null": lambda v: v is None or type(v) in (int, float),
    "text or null": lambda v: v is None or isinstance(v, str),
    "true or false": lambda v: isinstance(v, bool),
    "object": lambda v: isinstance(v, dict),
    "object or null": lambda v: v is None or isinstance(v, dict),
    "object of numbers": lambda v: all(type(x) in (int, float) for x in v.values()),
    "list": lambda v: isinstance(v, list),
    "list of text": lambda v: all(isinstance(x, str) for x in v),
    "list of numbers": lambda v: all(type(x) in (int, float) for x in v),
    "list of lists": lambda v: all(x is None or type(x) is float for row in v for x in row),
}


def _typed(data: dict[str, Any]) -> None:
    """Check a JSON against the page: every field is there, of its type, and none is more."""
    types = dict(re.findall(r"^\| `([^`]+)` \| ([^|]+) \|", _PAGE.read_text("utf-8"), re.M))
    inside = {path.rpartition(".")[0].removesuffix(".*") for path in types} - {""}

    def walk(value: Any, path: str) -> None:
        assert _TYPES[types[path]](value), (path, value)
        if path not in inside or value is None:
            return
        many = any(p.startswith(f"{path}.*.") for p in types)
        fixed = {p for p in types if p.rpartition(".")[0] == path}
        if isinstance(value, list) or (many and not fixed):
            for one in value if isinstance(value, list) else value.values():
                assert {f"{path}.*.{key}" for key in one} == {
                    p for p in types if p.rpartition(".")[0] == f"{path}.*"
                }
                for key, part in one.items():
                    walk(part, f"{path}.*.{key}")
            return
        assert {f"{path}.{key}" for key in value} == fixed
        for key, part in value.items():
            walk(part, f"{path}.{key}")

    assert set(data) == {p for p in types if "." not in p}
    for key, part in data.items():
        walk(part, key)


def written(path: Path, one: Record, name: str = "contact_force_n") -> str:
    """Write a record as CSV; returns its path."""
    path.parent.mkdir(exist_ok=True)
    np.savetxt(path, np.stack([one.time_s, one.value], 1), delimiter=",",
               header=f"time_s,{name}", comments="", fmt="%.12g")  # fmt: skip
    return str(path)


@pytest.mark.full
def test_json_has_the_fields_and_types_of_its_page(tmp_path: Path) -> None:
    elastic, yields = record(scene()), record(scene(*YIELDS), seed=4)
    one = written(tmp_path / "a" / "drop.csv", elastic)
    same_name = written(tmp_path / "b" / "drop.csv", record(scene(), seed=8))
    bad = written(tmp_path / "yields.csv", yields)
    late = written(tmp_path / "late.csv", replace(
        elastic, time_s=elastic.time_s[450:], value=elastic.value[450:]))  # fmt: skip
    free = ["--free", RADIUS]
    for words, code, model in (
        ([one, *free], 0, "fits"),
        ([bad, *free], 1, "does not fit"),
        ([late, *free, "--free", f"{HEIGHT}±5%"], 0, "cannot tell"),
        ([one, "--free", "plate.loss_factor", "--free", THICKNESS], 2, "fits"),
        ([one, *free, "--free", PRESSURE, *(f"--set={x}" for x in YIELDS)], 0, "fits"),
        ([one, same_name, *free, "--hold-out", same_name], 0, "fits"),
        ([one, *free, "--check"], 0, "cannot tell"),
        ([one, "--check", "--free", "plate.loss_factor"], 2, "cannot tell"),
        (["--check", "--expect", "v_p:150us:0.3%", "--free", "contact.stiffness_factor",
          "--free", "sphere.material.young_pa"], 2, "cannot tell"),
    ):  # fmt: skip
        path = tmp_path / "f.json"
        if "--check" not in words:
            words += ["--out", str(tmp_path / "o.toml")]
        ended = invoke(["fit", "aluminium-3mm", *words, "--json", str(path), "--overwrite"])
        assert ended.exit_code == code, ended.output
        text = path.read_text("utf-8")
        data = json.loads(text)
        assert "NaN" not in text
        assert "Infinity" not in text
        _typed(data)
        assert data["model"] == model
        assert data["checked_only"] == ("--check" in words)
        assert (data["scene"] is None) == (code == 2 or "--check" in words)
        if same_name in words:
            assert list(data["nuisances"]["by_record"]) == ["drop.csv", "drop.csv (2)"]
            assert data["hold_out"]["records"] == ["drop.csv"]


def test_a_key_that_is_free_twice_is_refused() -> None:
    with pytest.raises(FitError, match="given twice"):
        fitted(scene(), record(scene()), RADIUS, RADIUS)


def test_exit_codes_of_the_command(tmp_path: Path) -> None:
    one = record(scene(*YIELDS))
    path = tmp_path / "drop.csv"
    np.savetxt(path, np.stack([one.time_s, one.value], 1), delimiter=",",
               header="time_s,contact_force_n", comments="", fmt="%.12g")  # fmt: skip
    base = ["fit", "aluminium-3mm", str(path), "--out", str(tmp_path / "o.toml")]
    run = invoke
    assert run([*base, "--free", HEIGHT, "--exact"]).exit_code == 1
    assert run([*base, "--free", "plate.loss_factor", "--overwrite"]).exit_code == 2
    assert run([*base, "--overwrite"]).exit_code == 2
    missing = ["fit", "aluminium-3mm", str(tmp_path / "no.csv"), "--free", RADIUS]
    assert run(missing).exit_code == 2


@pytest.mark.parametrize("text", [
    "contact_force:80us:0.3%:0MHz", "contact_force:1e12us:0.3%", "contact_force:80us:0.3%:1e9MHz",
    "contact_force:1e1e1us:0.3%",
])  # fmt: skip
def test_an_expected_record_that_no_instrument_makes_is_refused(text: str) -> None:
    ended = invoke(["fit", "aluminium-3mm", "--check", "--expect", text, "--free", RADIUS])
    assert ended.exit_code == 2
    assert f"--expect {text}:" in ended.output


def test_a_check_names_every_key_that_it_calls_not_identifiable() -> None:
    expected = ["fit", "aluminium-3mm", "--check", "--expect", "contact_force:80us:0.4%"]
    ended = invoke([*expected, "--free", THICKNESS, "--free", "plate.loss_factor"])
    assert ended.exit_code == 2, ended.output
    named = " ".join(ended.output.split()).partition("Not identifiable from these records: ")[2]
    assert set(named.partition(". ")[0].split("; ")) == {THICKNESS, "plate.loss_factor"}


# Records of a solver that shares nothing with the package.


def of_drop(drop: Drop, quantity: str, duration_s: float, seed: int) -> Record:
    """A record at 2 MHz with 0.3 % noise, of a gain 1 % and a clock 30 ppm off."""
    time_s, force, speed = drop.simulate(duration_s)
    spline = scipy.interpolate.CubicSpline(time_s, force if quantity == "contact_force" else speed)
    generator = np.random.default_rng(seed)
    tau = np.arange(-250e-6 + generator.uniform() * 0.5e-6, duration_s, 0.5e-6)
    clean = np.where(tau > 0.0, spline(np.maximum(tau, 0.0)), 0.0)
    noise = 0.003 * np.max(np.abs(clean)) * generator.standard_normal(len(tau))
    return Record("drop", 0.0123 + tau * (1.0 + 3e-5), 1.01 * clean + noise, quantity)


@pytest.mark.parametrize(("drop", "quantity", "duration_s", "changes", "true"), [
    (Drop(pressure=9e8, height=0.06), "contact_force", 80e-6, (YIELDS[0],),
     {PRESSURE: 9e8, HEIGHT: 0.06}),
    (Drop(thickness=3.2e-3), "v_p", 6e-4, (), {THICKNESS: 3.2e-3, RADIUS: 3e-3}),
])  # fmt: skip
def test_records_of_another_solver_are_fitted(
    drop: Drop, quantity: str, duration_s: float, changes: tuple[str, ...], true: dict[str, float]
) -> None:
    start = scene("plate.loss_factor=1e-3", *changes)
    found = fitted(start, of_drop(drop, quantity, duration_s, 77), *true)
    assert found.model is ModelVerdict.FITS
    for estimate, value in zip(found.estimates, true.values(), strict=True):
        assert estimate.low is not None
        assert estimate.high is not None
        assert estimate.low < value < estimate.high


GLASS_BALL, CARBIDE = (64e9, 2500.0, 0.22), (600e9, 15000.0, 0.22)
ALUMINIUM, GLASS, BRASS = (7.2e10, 2700.0, 0.34), (6.4e10, 2480.0, 0.23), (1e11, 8500.0, 0.33)
OTHER_PLATES = [
    (Drop(3.1e-3, 0.12, 19.4e-3, of_ball=GLASS_BALL, of_plate=ALUMINIUM), 118e-6, (1.2, 1.0)),
    (Drop(4.2e-3, 0.16, 16.4e-3, of_ball=CARBIDE, of_plate=BRASS), 214e-6, (0.83, 1.2)),
    (Drop(10.1e-3, 0.12, 1.52e-3, of_ball=GLASS_BALL, of_plate=GLASS), 851e-6, (0.83, 1.2)),
]


@pytest.mark.parametrize(("drop", "duration_s", "off"), [
    OTHER_PLATES[0], *(pytest.param(*one, marks=pytest.mark.full) for one in OTHER_PLATES[1:]),
])  # fmt: skip
def test_plates_of_other_materials_are_found_from_a_start_20_percent_off(
    drop: Drop, duration_s: float, off: tuple[float, float]
) -> None:
    """In a few contacts their vibrations are out of phase: the first window has to be short."""
    names = ("young_pa", "density_kg_m3", "poisson")
    of_bodies = (("sphere", drop.of_ball), ("plate", drop.of_plate))
    start = scene(
        *(f"{body}.material.{name}={value}" for body, values in of_bodies
          for name, value in zip(names, values, strict=True)),
        f"plate.thickness_m={off[0] * drop.thickness}", f"sphere.radius_m={off[1] * drop.radius}",
        f"sphere.drop_height_m={drop.height}", "plate.loss_factor=1e-3", "plate.theory=kirchhoff",
    )  # fmt: skip
    true = {THICKNESS: drop.thickness, RADIUS: drop.radius}
    keys = [key for key, factor in zip(true, off, strict=True) if factor != 1.0]
    found = fitted(start, of_drop(drop, "v_p", duration_s, 5), *keys)
    assert found.model is ModelVerdict.FITS
    for estimate in found.estimates:
        assert estimate.low is not None
        assert estimate.high is not None
        assert estimate.low < true[estimate.key] < estimate.high


@pytest.mark.parametrize(("quantity", "filters"), [
    ("v_p", {}), ("acceleration", {"low_pass_hz": 60e3}),
])  # fmt: skip
def test_a_thick_plate_under_a_short_contact_gets_modes_enough_for_the_noise(
    quantity: str, filters: dict[str, float]
) -> None:
    """With the modes that the gap needs, the record is wrong by half the noise and more."""
    start = scene("sphere.material=glass", "plate.thickness_m=19.4e-3", "plate.theory=kirchhoff")
    seen = truth(start, quantity, 1.2e-4, MeasuringChain(**filters), accuracy=1e-7)
    one = measured(seen, Spoilt(noise=1e-3), 4, table=Measurement(**filters))  # type: ignore[arg-type]
    problem = prepare_problem(start, [one], [])
    [model], [channel] = problem.models, problem.channels
    fine = truth(start, quantity, 1.2e-4, MeasuringChain(**filters), accuracy=1e-8)
    tau = np.arange(0.0, 1.3 * model.contact_s, 1e-7)
    error = problem.simulate_channel(0, {}, 1.2e-4).value(tau) - fine.value(tau)
    assert channel.simulation_error == 0.0
    assert float(np.sqrt(np.mean(error**2))) < 0.2 * channel.noise
    assert fitted(start, one, THICKNESS).model is ModelVerdict.FITS


@pytest.mark.full
def test_a_simulation_that_cannot_be_fine_enough_says_so() -> None:
    changes = "sphere.radius_m=1e-3", "plate.thickness_m=2e-3", "plate.loss_factor=1e-3"
    start = scene(*changes)
    record = measured(truth(start, "v_p", 5e-3), Spoilt(noise=1e-3), 0, rate_hz=1e7)
    found = fitted(start, record, THICKNESS)
    assert found.model is ModelVerdict.CANNOT_TELL
    assert "The error of the simulation can explain that" in " ".join(found.reasons)
    wrong = fitted(scene(*changes, *YIELDS), record, THICKNESS)
    assert wrong.model is ModelVerdict.DOES_NOT_FIT


def test_draws_of_a_fitted_scene_follow_its_covariance(tmp_path: Path) -> None:
    from hertzloop.identification.fit.report import fitted_scene
    from hertzloop.studies.sweeps.uncertain import read_uncertain

    found = fitted(scene(), record(scene()), RADIUS, HEIGHT)
    path = tmp_path / "rig.toml"
    path.write_text(fitted_scene(found, "rig"))
    uncertain = read_uncertain(path, load(str(path)))
    assert uncertain.keys == [RADIUS, HEIGHT]
    drawn = [uncertain.draw(1, number) for number in range(4000)]
    rows = [[one[RADIUS], one[HEIGHT]] for one in drawn]
    np.testing.assert_allclose(np.cov(np.log(rows).T), found.covariance, rtol=0.1, atol=1e-12)
    with pytest.raises(SceneError, match="does not hold"):
        read_uncertain(path, load(str(path), ["sphere.radius_m=0.004"]))


def test_a_record_without_noise_is_as_exact_as_the_simulation() -> None:
    drop = Drop(radius=3.1e-3)
    time_s, force, _ = drop.simulate(80e-6)
    tau = np.arange(-250e-6, 80e-6, 0.5e-6)
    clean = np.interp(tau, time_s, force)
    found = fitted(scene("plate.loss_factor=1e-3"), Record("r", tau, clean, "contact_force"),
                   RADIUS)  # fmt: skip
    assert found.estimates[0].value == pytest.approx(3.1e-3, rel=1e-4)
    assert found.model is ModelVerdict.FITS


def test_a_plate_is_fitted_by_its_motion_beside_the_contact() -> None:
    point = (0.3, 0.27)
    model = FrozenModel(scene(), 5e-4, 1e-4, point)
    tau = np.arange(-2e-4, 4.5e-4, 1e-6)
    value = observe(model.run({}, 5e-4), "v_p", MeasuringChain(), True).value(tau)
    # Waves of 200 kHz run 54 mm in about 20 us: nothing moves there at once.
    early = (tau > 0.0) & (tau < 8e-6)
    assert np.max(np.abs(value[early])) < 0.05 * np.max(np.abs(value))
    noise = 0.003 * np.max(np.abs(value)) * np.random.default_rng(1).standard_normal(len(tau))
    one = Record("beside", tau, value + noise, "v_p", Measurement(quantity="v_p", point_m=point))
    [estimate] = fitted(scene("plate.thickness_m=0.0032"), one, THICKNESS).estimates
    assert estimate.low is not None
    assert estimate.high is not None
    assert estimate.low < 0.003 < estimate.high


@pytest.mark.full
def test_a_record_far_from_the_contact_is_aligned_by_the_wave_that_arrives() -> None:
    """13 cm away the wave comes when the contact is over, and grows long after."""
    point = (0.38, 0.26)
    model = FrozenModel(scene(), 1e-3, 1e-4, point, step_ns=125)
    tau = np.arange(-2.5e-4, 9.9e-4, 1e-6)
    value = observe(model.run({}, 1e-3), "v_p", MeasuringChain(low_pass_hz=1e5), True).value(tau)
    noise = 0.003 * np.max(np.abs(value)) * np.random.default_rng(1).standard_normal(len(tau))
    table = Measurement(quantity="v_p", low_pass_hz=1e5, point_m=point)
    one = Record("far", tau + 3e-3, value + noise, "v_p", table)
    found = fitted(scene("plate.thickness_m=0.0032"), one, THICKNESS)
    [estimate] = found.estimates
    assert estimate.low is not None
    assert estimate.high is not None
    assert estimate.low < 0.003 < estimate.high
    assert found.nuisances[0].time_shift_s == pytest.approx(3e-3, abs=1e-7)


@pytest.mark.full
def test_the_records_of_the_tutorial_give_the_true_values() -> None:
    from docs.examples.bench_records import EXAMPLES, TRUE

    setup = load(str(EXAMPLES / "bench.toml"))
    names = ("bench-force", "bench-velocity", "bench-force-higher")
    *records, held = (read_record(EXAMPLES / f"{name}.csv") for name in names)
    found = fit(setup, records, [parse_free_key(setup, key) for key in TRUE], [held])
    assert found.model is ModelVerdict.FITS
    assert found.hold_out is not None
    assert found.hold_out["residual_over_noise"] < 1.2
    for estimate in found.estimates:
        assert estimate.low is not None
        assert estimate.high is not None
        assert estimate.low < TRUE[estimate.key] < estimate.high


def test_cases_of_a_sweep_over_draws_run_again_with_the_same_keys(tmp_path: Path) -> None:
    from hertzloop.identification.fit.report import fitted_scene
    from hertzloop.studies.sweeps.replay_cases import replay_cases
    from hertzloop.studies.sweeps.sweep import read_results

    found = fitted(
        scene("run.duration_s=1.2e-3", "controller.law=slope_threshold"), record(scene()), RADIUS
    )
    path, results = tmp_path / "rig.toml", tmp_path / "rig.parquet"
    path.write_text(fitted_scene(found, "rig"))
    words = ["sweep", str(path), "--over", "controller.latency_us=0,2", "--uncertain", str(path),
             "--cases", "3", "--workers", "1", "--out", str(results)]  # fmt: skip
    ended = invoke(words)
    assert ended.exit_code == 0, ended.output
    assert "median (2.5 to 97.5 %)" in ended.output
    rows, header = read_results(results)
    assert len({row[RADIUS] for row in rows}) == 3
    assert len(rows) == 6
    checked = list(replay_cases(rows, header, 2, "compiled", 1))
    assert [one.same for one in checked] == [True, True]


@pytest.mark.full
def test_a_fit_of_poissons_ratio_solves_the_edges_a_few_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Poisson's ratio changes the shapes of a plate with other edges: each simulation solved them
    anew, and a fit took minutes."""
    edges = ["--set", "plate.edges=ccff", "--set", "controller.law=off"]
    recorded = ["--set", "sensors.quantity=v_p", "--set", "sensors.noise_rms=1e-3",
                "--set", "run.step_ns=250", "--set", "run.lead_in_s=3e-4",
                "--set", "run.duration_s=8e-4", "--set", "run.seed=2"]  # fmt: skip
    path, json_file = tmp_path / "drop.mcap", tmp_path / "fit.json"
    ended = invoke(["run", "aluminium-3mm", *edges, *recorded, "--out", str(path)])
    assert ended.exit_code == 0, ended.output
    solved, solve = [], edged_plate._solved

    def count(*given: Any) -> Any:
        solved.append(given)
        return solve(*given)

    monkeypatch.setattr(edged_plate, "_solved", count)
    start = ["--set", "plate.thickness_m=0.0031", "--set", "sensors.quantity=v_p"]
    ended = invoke([
        "fit", "aluminium-3mm", *edges, str(path), *start, "--free", THICKNESS, "--free",
        "plate.material.poisson", "--out", str(tmp_path / "fitted.toml"), "--json", str(json_file),
    ])  # fmt: skip
    found = json.loads(json_file.read_text())
    assert found["evaluations"] > 50
    # Four blocks by symmetry, in two bases: of the start, the solution, and plates between.
    assert len(solved) <= 4 * 8
    for key, true in ((THICKNESS, 0.003), ("plate.material.poisson", 0.34)):
        assert found["parameters"][key]["value"] == pytest.approx(true, rel=0.02), ended.output


def test_a_fit_says_how_far_it_is() -> None:
    one, told = record(scene(*YIELDS)), []
    start = scene(YIELDS[0], "contact.limiting_pressure_pa=1.1e9")
    found = fit(
        start, [one], [parse_free_key(start, PRESSURE)],
        on_progress=lambda done, expected: told.append((done, expected)),
    )  # fmt: skip
    done = [d for d, _ in told]
    assert done == sorted(done)
    assert all(d < expected < 20 * found.evaluations for d, expected in told)
    assert done[-1] > 0.5 * found.evaluations


@pytest.mark.parametrize(
    "number",
    [
        123,  # waves from the edges, shifted by a period, fit almost as well
        128,  # the converter rests at one level while the contact takes most of the record
    ],
)
def test_records_of_the_independent_solver(number: int, tmp_path: Path) -> None:
    from tests.identification.many_records import written

    _, path, start, true = written(number, tmp_path)
    found = fit(start, [read_record(path)], [parse_free_key(start, key) for key in true])
    assert found.model is ModelVerdict.FITS
    for e in found.estimates:
        assert e.value == pytest.approx(true[e.key], rel=0.01), e.key
