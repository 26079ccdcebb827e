"""Several hits of a hammer in one record: found, judged, fitted together, and one held out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.identification.fit.check import check
from hertzloop.identification.fit.errors import FitError
from hertzloop.identification.fit.file_description import describe_file
from hertzloop.identification.fit.fit import fit
from hertzloop.identification.fit.free_keys import parse_free_key
from hertzloop.identification.fit.hits import describe_hits, find_hits, split_hits
from hertzloop.identification.fit.report import fit_table, sentences
from hertzloop.identification.fit.verdicts import KeyVerdict
from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.measurement import Measurement
from hertzloop.identification.records.reading import read_records
from hertzloop.identification.records.record import Record
from hertzloop.scene.setup import Setup, load
from tests.identification.fitting import write_csv

STIFFNESS, SPEED = "hammer.tip_stiffness", "hammer.speed_m_s"
RATE_HZ = 51_200.0


def rig(*changes: str) -> Setup:
    return load("aluminium-20mm", [
        "controller.law=off", "hammer.mass_kg=0.1", "hammer.speed_m_s=0.5",
        "hammer.tip_stiffness=2e6", "hammer.tip_exponent=1", *changes,
    ])  # fmt: skip


def train(*pulses: tuple[float, float], noise: float = 1e-3, lasts_s: float = 1.0) -> Record:
    """Half sines of 1 ms in a record, each with its start (s) and its size."""
    time_s = np.arange(round(lasts_s * RATE_HZ)) / RATE_HZ
    value = noise * np.random.default_rng(2).standard_normal(len(time_s))
    for start_s, size in pulses:
        phase = (time_s - start_s) / 1e-3
        value += np.where((phase > 0) & (phase < 1), size * np.sin(np.pi * phase), 0.0)
    return Record("train.csv", time_s, value, "contact_force")


def of_speeds(*speeds_m_s: float) -> Record:
    """A record of hits at these speeds, every 0.2 s, as a recorder at 51.2 kHz sees them."""
    parts = []
    for number, speed in enumerate(speeds_m_s):
        seen = truth(rig(f"hammer.speed_m_s={speed}"), "contact_force", 2e-3, accuracy=1e-4)
        parts.append(measured(seen, Spoilt(gain=1.01), 7 + number, rate_hz=RATE_HZ, quiet_s=4e-3))
    noise = 0.003 * float(np.max(parts[0].value))
    value = noise * np.random.default_rng(3).standard_normal(round(0.2 * len(parts) * RATE_HZ))
    for number, part in enumerate(parts):
        at = round((0.2 * number + 0.05) * RATE_HZ)
        value[at : at + len(part.value)] = part.value
    time_s = np.arange(len(value)) / RATE_HZ
    return Record("hits.csv", time_s, value, "contact_force", Measurement(quantity="contact_force"))


def test_hits_are_found_and_judged() -> None:
    pulses = (0.1, 1.0), (0.3, 0.6), (0.31, 0.3), (0.5, 0.8), (0.7, 0.2)
    found = find_hits(train(*pulses), True)
    assert [round(hit.first / RATE_HZ, 3) for hit in found] == [0.1, 0.3, 0.5, 0.7]
    assert [hit.peak_n for hit in found] == pytest.approx([1.0, 0.6, 0.8, 0.2], rel=0.01)
    assert [hit.defect[:20] for hit in found] == ["", "double hit: the seco", "", ""]
    assert "follows after 10 ms" in found[1].defect
    one = train(*pulses)
    cut = replace(one, value=np.minimum(one.value, 0.9))
    assert [bool(hit.defect) for hit in find_hits(cut, True)] == [True, True, False, False]
    assert "clipped" in find_hits(cut, True)[0].defect
    early = replace(one, time_s=one.time_s[5115:], value=one.value[5115:])
    assert find_hits(early, True)[0].defect == "6 samples before it, and 16 are needed"
    assert describe_hits(found, one)[3] == (
        "train.csv, hit 4: 0.1988 N at 0.700098 s, 7171 samples before it; used."
    )


def test_bounces_of_a_sphere_are_one_drop() -> None:
    falling = (0.1, 1.0), (0.3, 0.7), (0.45, 0.5), (0.6, 1.0), (0.8, 0.6)
    assert [hit.first for hit in find_hits(train(*falling), False)] == [5121, 30721]
    assert len(find_hits(train(*falling), True)) == 5
    sphere = load("aluminium-3mm", ["controller.law=off"])
    several = split_hits([train(*falling)], sphere)
    assert [one.name for one in several] == ["train.csv, hit 1", "train.csv, hit 2"]
    assert [one.hit for one in several] == [1, 2]
    assert split_hits([train((0.1, 1.0), (0.3, 0.7))], sphere)[0].hit == 0


def test_a_structure_that_still_moves_spoils_a_hit() -> None:
    force = train((0.1, 1.0), (0.3, 1.0), (0.9, 1.0))
    after = [force.time_s - start for start in (0.1, 0.3, 0.9)]
    motion = sum(np.where(t > 0, np.sin(3e3 * t) * np.exp(-10.0 * t), 0.0) for t in after)
    moving = replace(force, name="a", value=motion, quantity="acceleration")
    found = find_hits(force, True, [moving])
    assert [bool(hit.defect) for hit in found] == [False, True, False]
    assert found[1].defect == "acceleration before it: the structure still moves"


def test_files_of_single_hits_are_paired_by_their_order() -> None:
    force = train((0.1, 1.0))
    motion = replace(force, quantity="acceleration")
    found = split_hits([force, force, motion, motion], rig())
    assert [one.hit for one in found] == [1, 2, 1, 2]
    assert found[0].measurement.clock == found[2].measurement.clock != found[1].measurement.clock
    with pytest.raises(RecordError, match="double hit"):
        split_hits([train((0.1, 1.0), (0.12, 1.0), (0.4, 1.0), (0.42, 1.0))], rig())


@pytest.mark.full
def test_hits_share_the_tip_and_one_is_held_out() -> None:
    record = of_speeds(0.5, 0.35, 0.6)
    start = rig("hammer.tip_stiffness=2.4e6", "hammer.speed_m_s=5")
    found = fit(start, [record], [parse_free_key(start, STIFFNESS)])
    by_key = {e.key: e for e in found.estimates}
    assert list(by_key) == [STIFFNESS, f"{SPEED}[1]", f"{SPEED}[2]"]
    for key, true in ((STIFFNESS, 2e6), (f"{SPEED}[1]", 0.5), (f"{SPEED}[2]", 0.35)):
        low, high = by_key[key].low, by_key[key].high
        assert low < true < high
    assert by_key[STIFFNESS].verdict is KeyVerdict.IDENTIFIED
    # The sensor is the same in all hits, and so is its gain.
    assert found.nuisances[0].gain == found.nuisances[1].gain == pytest.approx(1.01, abs=0.03)
    assert found.hold_out["records"] == ["hits.csv, hit 3"]
    assert found.hold_out["residual_over_noise"] == pytest.approx(1.0, abs=0.15)
    assert 0.0 < found.hold_out["largest_percent"][0] < 1.5
    said = sentences(found)
    assert any("hit 3 (held out): good to" in line for line in said)
    assert any("holds for hammer.mass_kg = 0.1 and hammer.tip_exponent = 1:" in s for s in said)
    assert found.speeds_m_s == pytest.approx((0.35, 0.5), rel=0.05)
    assert found.setup.scene.hammer.speed_m_s == by_key[f"{SPEED}[1]"].value
    assert fit_table(found).keys == (STIFFNESS,)
    assert len(fit_table(found).covariance_log) == 1


@pytest.mark.full
def test_any_hit_can_be_held_out() -> None:
    record = of_speeds(0.5, 0.35)
    free = [parse_free_key(rig(), STIFFNESS)]
    found = fit(rig(), [record], free, hold_out=[1])
    assert [e.key for e in found.estimates] == [STIFFNESS]
    assert found.hold_out["records"] == ["hits.csv, hit 1"]
    assert fit(rig(), [record], free, hold_out=[]).hold_out is None
    with pytest.raises(FitError, match=r"--hold-out 3: cannot be held out\. The hits are 1, 2"):
        fit(rig(), [record], free, hold_out=[3])
    assert len(check(rig(), [record], free).estimates) == 3


def test_check_lists_the_hits(tmp_path: Path) -> None:
    one = train((0.1, 1.0), (0.3, 0.6), (0.31, 0.3))
    path = Path(write_csv(tmp_path / "train.csv", one))
    assert len(read_records(path)) == 1
    lines = describe_file(path)
    assert any(line.startswith("train.csv, hit 1: 0.9997 N") and "used." in line for line in lines)
    assert any("not used (double hit" in line for line in lines)
