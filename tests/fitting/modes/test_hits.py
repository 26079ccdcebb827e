"""Modes from hits of a hammer: accuracy, held-out data, delays, windows, and what is refused."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

from hertzloop.fitting.modes import from_hits
from hertzloop.fitting.modes.delay import correct_delay, delay_force
from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.modes.from_hits import modes_of_hits
from hertzloop.fitting.modes.hit_responses import HitResponse, hits_of_records, read_hits
from hertzloop.fitting.modes.hit_rows import rows_of_hits
from hertzloop.fitting.modes.identify import identify_modes
from hertzloop.fitting.modes.measured_modes import HoldOutCheck, MeasuredModes
from hertzloop.fitting.modes.picture import draw
from hertzloop.fitting.modes.response_rows import FittedModes
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.reading import read_record
from hertzloop.fitting.records.record import Record
from hertzloop.plant.structures.mode_file import read_modes
from tests.commands import invoke
from tests.fitting.modes.known import (
    CONTACT,
    FLEXIBILITY,
    HZ,
    KNOWN,
    LOSS,
    OTHER,
    near,
    silent,
)
from tests.tiers import default

HAMMER = Path(__file__).resolve().parents[3] / "docs" / "examples" / "hammer"


def records(
    shape: np.ndarray, hits: int = 3, noise: float = 1e-3, flexibility: float = 0.0
) -> list[Record]:
    """Hits on the known modes, stepped exactly in fine steps, with noise."""
    rate, fine, count = 12800, 16, 800
    dt, rng = 1 / rate / fine, np.random.default_rng(4)
    found = []
    for i in range(hits):
        share = np.clip((np.arange(count * fine) * dt - 2e-3) / 5e-4, 0, 1)
        force = (50 + 20 * i) * np.sin(np.pi * share) ** 2
        motion = flexibility * np.gradient(np.gradient(force, dt), dt)
        for hz, loss, contact, there in zip(HZ, LOSS, CONTACT, shape, strict=True):
            w = 2 * np.pi * hz
            system = scipy.signal.cont2discrete(
                ([contact * there, 0, 0], [1, loss * w, w * w]), dt, "foh"
            )
            motion = motion + scipy.signal.lfilter(np.ravel(system[0]), system[1], force)
        # A contact force pushes the structure down.
        for name, quantity, values in (("f", "contact_force", force[::fine]),
                                       ("a", "acceleration", -motion[::fine])):  # fmt: skip
            spoilt = values + noise * np.max(np.abs(values)) * rng.standard_normal(count)
            found.append(Record(f"{name}{i}", np.arange(count) / rate, spoilt, quantity))
    return found


def test_hits_give_the_modes_and_predict_a_held_out_hit():
    every = records(CONTACT, flexibility=FLEXIBILITY / 100)
    fitted, held = hits_of_records(every[:4]), hits_of_records(every[4:])
    found = modes_of_hits(fitted, held, True, silent)
    assert [one.name for one in found.held_out] == ["f2, a2"]
    assert found.held_out[0].rms < 0.02
    for hz, loss, shape in zip(HZ, LOSS, CONTACT, strict=True):
        i = near(found.table, hz)
        assert found.table.omega_rad_s[i] == pytest.approx(2 * np.pi * hz, rel=2e-4)
        assert found.table.loss_factor[i] == pytest.approx(loss, rel=0.1)
        assert found.table.shape_contact[i] == pytest.approx(shape, rel=0.02)


def test_a_sensor_that_looks_down_at_the_contact_point_is_refused():
    hits = hits_of_records(records(-CONTACT, hits=2))
    with pytest.raises(ModalDataError, match="turn the sign of the response"):
        modes_of_hits(hits[:1], hits[1:], True, silent)


@pytest.mark.full
def test_hits_elsewhere_need_the_sensor():
    """Residues of both signs are of no drive point; with a sensor, the product of shapes is the
    measured residue."""
    hits = hits_of_records(records(OTHER, hits=2))
    with pytest.raises(ModalDataError, match="--sensor: is missing"):
        modes_of_hits(hits[:1], hits[1:], True, silent)
    found = modes_of_hits(hits[:1], hits[1:], False, silent)
    assert "Measure there too" in found.notes[0]
    for hz, product in zip(HZ, CONTACT * OTHER, strict=True):
        i = near(found.table, hz)
        both = found.table.shape_contact[i] * found.table.shape_sensor[i]
        assert both == pytest.approx(product, rel=0.03)


def test_hits_that_are_refused():
    force, motion, other, last = records(CONTACT, hits=2)
    later = Record("late", motion.time_s + 1e-5, motion.value, "acceleration")
    early = Record("early", force.time_s[:-25], force.value[25:], "contact_force")
    speed = Record("v", last.time_s, last.value, "v_p")
    passed = Record(
        "slow", motion.time_s, motion.value, "acceleration", Measurement(low_pass_hz=1e3)
    )
    gap = Record("gap", motion.time_s, motion.value, "xi")
    for some, sentence in [
        ([force, other, motion], "--from: 2 records of a force and 1 of a response"),
        ([force, later], "were not sampled at the same, evenly spaced times"),
        ([early, Record("m", early.time_s, motion.value[25:], "acceleration")],
         "has . samples before the hit. Give at least 8"),
        ([force, motion, other, speed], "has another quantity or rate"),
        ([force, passed], "name different filters"),
        ([replace(force, value=-force.value), motion], "its peak is negative"),
        ([replace(force, value=np.minimum(force.value, 30.0)), motion], r"f0: has \d+ samples"),
        ([force, gap], "is neither a force nor a motion"),
        ([replace(motion, quantity="contact_force"), replace(force, quantity="acceleration")],
         "a0: has both signs, .* Check whether force and response are swapped"),
        ([force, replace(motion, value=motion.value + np.sin(900 * motion.time_s) * 300)],
         r"a0: is not at rest before the hit: the rms of acceleration there is \d+ % of its larg"),
        ([force, replace(motion, value=np.where(motion.time_s > 0.05, np.nan, motion.value))],
         "a0: has gaps in its values"),
    ]:  # fmt: skip
        with pytest.raises(ModalDataError, match=sentence):
            hits_of_records(some)


def test_a_file_may_hold_both_and_a_record_several_hits(tmp_path):
    force, motion, other, last = records(CONTACT, hits=2)
    expected = hits_of_records([force, motion, other, last])
    columns = [force.time_s, motion.value, force.value]
    text = "time_s,acceleration_m_s2,contact_force_n"
    np.savetxt(tmp_path / "hit.csv", np.transpose(columns), delimiter=",", header=text, comments="")
    [found] = read_hits([tmp_path / "hit.csv"])
    assert np.allclose(found.force_n, expected[0].force_n, rtol=1e-12, atol=1e-12)
    assert np.allclose(found.response, expected[0].response, rtol=1e-12, atol=1e-9)
    still = np.zeros(4000)
    in_a_row = [
        Record(name, np.arange(9600) / 12800, np.concatenate([one, still, two, still]), quantity)
        for name, one, two, quantity in (("f", force.value, other.value, "contact_force"),
                                         ("a", motion.value, last.value, "acceleration"))
    ]  # fmt: skip
    found, second = hits_of_records(in_a_row)
    assert (found.name, second.name) == ("f, a, hit 1", "f, a, hit 2")
    assert abs(second.first - 128) <= 1  # 10 ms
    end = slice(second.first, second.first + 600)
    there = slice(expected[1].first, expected[1].first + 600)
    assert np.allclose(second.force_n[end], expected[1].force_n[there], atol=0.2)


def test_of_several_hits_the_clipped_one_is_left_out():
    force, motion, other, last = records(CONTACT, hits=2)
    still = np.zeros(2000)
    values = {
        "contact_force": [force.value, still, np.minimum(other.value, 30.0), still, other.value],
        "acceleration": [motion.value, still, last.value, still, last.value],
    }
    together = [
        Record(name, np.arange(6400) / 12800, np.concatenate(parts), name)
        for name, parts in values.items()
    ]
    found = hits_of_records(together)
    assert [one.name for one in found] == [
        "contact_force, acceleration, hit 1", "contact_force, acceleration, hit 3",
    ]  # fmt: skip
    [note] = found[0].notes
    assert re.match(r"Left out: contact_force, hit 2: has \d+ samples that are clipped", note)


def test_an_offset_and_noise_do_not_hide_the_hit():
    force, motion = records(CONTACT, hits=1)
    [plain] = hits_of_records([force, motion])
    [moved] = hits_of_records([replace(force, value=force.value + 9.0), motion])
    assert np.allclose(moved.force_n, plain.force_n, atol=1e-12)
    noisy = force.value + 1.5 * np.random.default_rng(3).standard_normal(len(force.value))
    [hit] = hits_of_records([replace(force, value=noisy), motion])
    assert abs(hit.first - plain.first) <= 2
    assert not np.any(hit.force_n[plain.first + 20 :])  # noise is not taken as force
    assert not np.any(hit.force_n[: plain.first - 4])
    assert np.any(plain.force_n[plain.first + 20 :])


@pytest.mark.full
def test_hits_of_other_responses_are_told():
    force, motion, other, last = records(CONTACT, hits=2)
    swapped = hits_of_records([force, last, other, motion])
    found = modes_of_hits(swapped, [], False, silent)
    assert re.search(r"error of \d\d % is large: .* same hits in the same order", found.notes[0])


def test_a_response_from_rest_is_exact():
    """Rows of a mode against the exact steps of the records, without noise."""
    hit = hits_of_records(records(CONTACT, hits=1, noise=0.0))[0]
    rows = rows_of_hits([hit], False).basis(2 * np.pi * HZ, LOSS)
    expected = (CONTACT**2) @ rows
    assert np.max(np.abs(expected - hit.response)) < 2e-3 * np.max(np.abs(hit.response))


def test_the_smallest_error_decides_on_the_number_of_modes():
    hit = hits_of_records(records(CONTACT, hits=1, noise=0.0))[0]
    observed, tried = rows_of_hits([hit], False), []

    def error(modes: Any) -> float:
        tried.append(len(modes.omega_rad_s))
        return abs(len(modes.omega_rad_s) - 4) + 1.0

    assert len(identify_modes(observed, error).omega_rad_s) == 4
    assert tried[:2] == [0, 4]


def test_the_turn_with_the_least_error_gives_the_modes(monkeypatch):
    fitted, nothing = iter((1.0, 2.0, 3.0)), np.empty(0)
    errors = {1.0: 0.1, 2.0: 0.5, 3.0: 0.3}

    def identified(*_: Any, **__: Any) -> FittedModes:
        return FittedModes(np.array([next(fitted)]), nothing, nothing, nothing, 0.0)

    def predicted(modes: FittedModes, *_: Any) -> list[HoldOutCheck]:
        rms = errors[float(modes.omega_rad_s[0])]
        return [HoldOutCheck("", 1, rms, rms, nothing, nothing, nothing)]

    monkeypatch.setattr(from_hits, "identify_modes", identified)
    monkeypatch.setattr(from_hits, "_predict_hits", predicted)
    hits = hits_of_records(records(CONTACT))
    best, checks = from_hits._best_turn([(hits, hits[:1])] * 3, False, silent)
    assert [one.rms for one in checks] == [0.1, 0.5, 0.3]
    assert best.omega_rad_s[0] == 1.0


def delayed(hits: list[HitResponse], samples: float) -> list[HitResponse]:
    """The same hits, recorded with the response late by so many samples."""
    return [replace(delay_force(hit, -samples), first=hit.first) for hit in hits]


def of_known_modes(found: MeasuredModes) -> None:
    table = found.table
    assert len(table.omega_rad_s) == len(HZ)
    assert np.allclose(table.omega_rad_s, KNOWN.omega_rad_s, rtol=2e-4)
    assert np.allclose(table.loss_factor, LOSS, rtol=0.1)
    assert np.allclose(table.shape_contact, CONTACT, rtol=0.02)


@pytest.mark.parametrize("samples", default([1.0, -0.5], [-0.5]))
def test_a_late_response_is_corrected_and_told(samples):
    late = delayed(hits_of_records(records(CONTACT)), samples)
    found = modes_of_hits(late[:2], late[2:], True, silent)
    of_known_modes(found)
    assert found.delay_s * 12800 == pytest.approx(samples, abs=0.02)
    word, plural = "late" if samples > 0 else "early", "" if samples == 1.0 else "s"
    assert found.notes[0].startswith(
        f"The response is {word} by {abs(samples):.2f} sample{plural} ("
    )


def test_a_late_response_elsewhere_and_in_noise():
    late = delayed(hits_of_records(records(OTHER, hits=2, noise=0.01)), 1.0)
    found = modes_of_hits(late[:1], late[1:], False, silent)
    assert found.delay_s * 12800 == pytest.approx(1.0, abs=0.03)
    assert found.held_out[0].rms < 0.1


def test_no_delay_changes_nothing():
    hits = hits_of_records(records(CONTACT))
    same, others, late = correct_delay(hits[:2], hits[2:])
    assert late == 0.0
    assert all(one is other for one, other in zip(same + others, hits, strict=True))


def windowed(hits: list[HitResponse], time_s: float, *, both: bool) -> list[HitResponse]:
    """The same hits, as a recorder with an exponential window gives them."""
    found = []
    for hit in hits:
        t = hit.interval_s * (np.arange(len(hit.force_n)) - (0 if both else hit.first))
        window = np.exp(-np.maximum(t, 0.0) / time_s)
        force = hit.force_n * window if both else hit.force_n
        found.append(replace(hit, force_n=force, response=hit.response * window))
    return found


@pytest.mark.parametrize(("time_s", "both"), [(0.02, False), (0.02, True), (0.1, False)])
def test_an_exponential_window_adds_no_damping(time_s, both):
    hits = windowed(hits_of_records(records(CONTACT)), time_s, both=both)
    given = [replace(hit, window_s=time_s) for hit in hits]
    of_known_modes(modes_of_hits(given[:2], given[2:], True, silent))


def test_a_window_that_was_not_given_is_told():
    hits = windowed(hits_of_records(records(CONTACT)), 0.02, both=False)
    found = modes_of_hits(hits[:2], hits[2:], True, silent)
    [note] = [note for note in found.notes if "peaks of the response" in note]
    assert "give --exponential-window SECONDS" in note


def test_a_window_that_takes_more_damping_than_there_is():
    hits = [replace(hit, window_s=0.05) for hit in hits_of_records(records(CONTACT))]
    with pytest.raises(ModalDataError, match=r"--exponential-window = 0\.05: the mode at"):
        modes_of_hits(hits[:2], hits[2:], True, silent)


@pytest.mark.full
def test_each_measured_hit_is_predicted_by_the_others(tmp_path):
    """The promise: at most 8 % of its rms in the first 40 ms."""
    every = [read_record(HAMMER / f"{kind}{i}.csv") for kind in "fa" for i in (1, 2, 3)]
    found = modes_of_hits(hits_of_records(every), [], False, silent)
    assert [one.name for one in found.held_out] == [f"f{i}.csv, a{i}.csv" for i in (1, 2, 3)]
    assert max(one.rms for one in found.held_out) < 0.04
    draw(found, tmp_path / "hits.png")
    assert (tmp_path / "hits.png").stat().st_size > 10_000


def written(tmp_path: Path, hits: int = 1) -> list[str]:
    """Files of hits, with force and response side by side."""
    every = records(CONTACT, hits=hits)
    paths = [tmp_path / f"h{i}.csv" for i in range(hits)]
    for path, force, motion in zip(paths, every[::2], every[1::2], strict=True):
        np.savetxt(path, np.c_[force.time_s, force.value, motion.value], delimiter=",",
                   header="time_s,contact_force_n,acceleration_m_s2", comments="")  # fmt: skip
    return list(map(str, paths))


def test_modes_are_written_though_their_scene_cannot_be_run(tmp_path):
    """The scene is refused when it is run, not when its modes are converted."""
    modes, data = str(tmp_path / "m.csv"), tmp_path / "m.json"
    files = ["scene", "modes", "--from", *written(tmp_path, 2), "-o", modes, "--json", str(data)]
    for words, cause in (
        (["--contact", "hit"], "too low for an impact"),
        (["--contact", "hit", "--sensor", "there"], "does not give residual_flexibility_m_n"),
    ):
        done = invoke([*files, *words, "--overwrite"])
        assert done.exit_code == 0, done.output
        assert "The scene cannot be run yet: " in done.output
        assert cause in json.loads(data.read_text())["warning"]
        run = invoke(["run", str(tmp_path / "m.toml")])
        assert (run.exit_code, cause in run.output) == (2, True)
    assert len(read_modes("m.csv", Path(modes).read_bytes()).omega_rad_s) == len(HZ)
    wrong = invoke([*files, "--contact", "hit", "--overwrite", "--set", "run.duration_s=-1"])
    assert (wrong.exit_code, "run.duration_s" in wrong.output) == (2, True)


def test_options_that_are_refused(tmp_path):
    files = written(tmp_path)
    hits = [str(HAMMER / name) for name in ("f1.csv", "a1.csv")]
    for words, sentence in [
        (["--exponential-window", "0.1"], "describes a measured structure. Add --from FILE"),
        (["--from", *files, "--contact", "a", "--exponential-window", "0"], "must be positive"),
        (["--from", "a.uff", "--contact", "1", "--exponential-window", "1"], "for records of hits"),
        (["--from", *hits, "--contact", "A", "--hold-out", str(HAMMER / "a3.csv")],
         "--hold-out: 0 records of a force and 1 of a response"),
        (["--from", *hits, hits[0], "--contact", "A"], "f1.csv: is given twice"),
        (["--from", *hits, "--contact", "A", "--hold-out", hits[0], "--hold-out", hits[1]],
         "--hold-out: leaves no file of --from"),
    ]:  # fmt: skip
        done = invoke(["scene", "modes", *words])
        assert done.exit_code == 2, done.output
        assert sentence in done.output
