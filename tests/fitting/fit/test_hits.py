"""Several hits of a hammer in one record: listed, fitted together, and one held out."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.fitting.fit.check import check
from hertzloop.fitting.fit.errors import FitError
from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.hold_out import split_hold_out
from hertzloop.fitting.fit.keys.free_key_option import parse_free_key
from hertzloop.fitting.fit.reports.file_description import describe_file
from hertzloop.fitting.fit.reports.fit_text import sentences
from hertzloop.fitting.fit.reports.fitted_scene import fit_table
from hertzloop.fitting.fit.verdicts import KeyVerdict
from hertzloop.fitting.hits.split import split_hits
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.reading import read_record, read_records
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup, load
from tests.fitting.fitting import write_csv
from tests.fitting.hits.trains import RATE_HZ, train

STIFFNESS, SPEED = "hammer.tip_stiffness", "hammer.speed_m_s"


def rig(*changes: str) -> Setup:
    return load(
        "aluminium-20mm",
        [
            "controller.law=off",
            "hammer.mass_kg=0.1",
            "hammer.speed_m_s=0.5",
            "hammer.tip_stiffness=2e6",
            "hammer.tip_exponent=1",
            *changes,
        ],
    )


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


@pytest.mark.full
def test_hits_share_the_tip_and_one_is_held_out():
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
def test_any_hit_can_be_held_out():
    record = of_speeds(0.5, 0.35)
    free = [parse_free_key(rig(), STIFFNESS)]
    found = fit(rig(), [record], free, hold_out=[1])
    assert [e.key for e in found.estimates] == [STIFFNESS]
    assert found.hold_out["records"] == ["hits.csv, hit 1"]
    assert fit(rig(), [record], free, hold_out=[]).hold_out is None
    with pytest.raises(FitError, match=r"--hold-out 3: cannot be held out\. The hits are 1, 2"):
        fit(rig(), [record], free, hold_out=[3])
    assert len(check(rig(), [record], free).estimates) == 3


def test_a_number_and_a_record_with_hits_are_not_held_out_together():
    records = split_hits([of_speeds(1.0, 0.8)], rig())
    with pytest.raises(FitError, match="cannot be combined with the hits of"):
        split_hold_out(records, [1, of_speeds(1.0, 0.8)], rig())


def test_check_lists_the_hits(tmp_path):
    one = train((0.1, 1.0), (0.3, 0.6), (0.31, 0.3))
    path = Path(write_csv(tmp_path / "train.csv", one))
    assert len(read_records(path)) == 1
    lines = describe_file(path)
    assert any(line.startswith("train.csv, hit 1: 0.9997 N") and "used." in line for line in lines)
    # Without a scene, nothing says what the striker is.
    assert lines[-2].endswith(
        "a second contact follows after 10 ms: a bounce of a sphere, or a double hit of a hammer."
    )
    assert lines[-1] == (
        "train.csv: 1 drop of a sphere, or 2 hits of a hammer. After a drop, a contact with a "
        "smaller force is a bounce."
    )


@pytest.mark.full
def test_hits_on_another_structure_are_not_identifiable():
    """At a bound of the stiffness the touch may leave the record, which explains nothing."""
    folder = Path(__file__).resolve().parents[3] / "docs" / "examples" / "hammer"
    start = rig("hammer.speed_m_s=0.1", "hammer.tip_stiffness=1.7e7")
    forces = [read_record(folder / f"f{hit}.csv") for hit in (1, 2, 3)]
    found = fit(start, forces, [parse_free_key(start, STIFFNESS)])
    assert {e.verdict for e in found.estimates} == {KeyVerdict.NOT_IDENTIFIABLE}
    assert found.residual_over_noise > 100.0
