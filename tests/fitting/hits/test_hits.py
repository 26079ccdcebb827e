"""Hits in a record: found, judged, and split from each other."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.fitting.hits.find import DROPS, EXCITATION, HAMMER, Hit, HitRules, find_hits
from hertzloop.fitting.hits.judge import describe_hits, judge_hits
from hertzloop.fitting.hits.onset import find_onset, noise_after
from hertzloop.fitting.hits.split import split_hits
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import load
from tests.fitting.hits.trains import RATE_HZ, train

HAMMER_SCENE = load(
    "aluminium-20mm",
    [
        "controller.law=off",
        "hammer.mass_kg=0.1",
        "hammer.speed_m_s=0.5",
        "hammer.tip_stiffness=2e6",
        "hammer.tip_exponent=1",
    ],
)


def judged(force: Record, rules: HitRules, others: Sequence[Record] = ()) -> list[Hit]:
    return judge_hits(find_hits(force, rules), force, others, rules)


def test_hits_are_found_and_judged():
    pulses = (0.1, 1.0), (0.3, 0.6), (0.31, 0.3), (0.5, 0.8), (0.7, 0.2)
    found = judged(train(*pulses), HAMMER)
    assert [round(hit.first / RATE_HZ, 3) for hit in found] == [0.1, 0.3, 0.5, 0.7]
    assert [hit.peak_n for hit in found] == pytest.approx([1.0, 0.6, 0.8, 0.2], rel=0.01)
    assert [hit.defect[:20] for hit in found] == ["", "is a double hit: a s", "", ""]
    assert "follows after 10 ms" in found[1].defect
    one = train(*pulses)
    cut = replace(one, value=np.minimum(one.value, 0.9))
    assert [bool(hit.defect) for hit in judged(cut, HAMMER)] == [True, True, False, False]
    assert "samples that are clipped" in judged(cut, HAMMER)[0].defect
    early = replace(one, time_s=one.time_s[5115:], value=one.value[5115:])
    assert judged(early, HAMMER)[0].defect == (
        "has 6 samples before the hit. Give at least 16, at rest."
    )
    assert describe_hits(found, one)[3] == (
        "train.csv, hit 4: 0.1988 N at 0.700098 s, 7171 samples before it; used."
    )


def test_bounces_of_a_sphere_are_one_drop():
    falling = (0.1, 1.0), (0.3, 0.7), (0.45, 0.5), (0.6, 1.0), (0.8, 0.6)
    assert [hit.first for hit in find_hits(train(*falling), DROPS)] == [5121, 30721]
    assert len(find_hits(train(*falling), HAMMER)) == 5
    sphere = load("aluminium-3mm", ["controller.law=off"])
    several = split_hits([train(*falling)], sphere)
    assert [one.name for one in several] == ["train.csv, hit 1", "train.csv, hit 2"]
    assert [one.hit for one in several] == [1, 2]
    assert split_hits([train((0.1, 1.0), (0.3, 0.7))], sphere)[0].hit == 0


def test_a_structure_that_still_moves_spoils_a_hit():
    force = train((0.1, 1.0), (0.3, 1.0), (0.9, 1.0))
    after = [force.time_s - start for start in (0.1, 0.3, 0.9)]
    motion = sum(np.where(t > 0, np.sin(3e3 * t) * np.exp(-10.0 * t), 0.0) for t in after)
    moving = replace(force, name="a", value=motion, quantity="acceleration")
    found = judged(force, HAMMER, [moving])
    assert [bool(hit.defect) for hit in found] == [False, True, False]
    assert found[1].defect.startswith(
        "is not at rest before the hit: the rms of acceleration there"
    )


def test_missing_samples_are_no_second_contact():
    force = train((0.1, 1.0), (0.3, 1.0))
    force.value[round(0.1005 * RATE_HZ) :][:3] = np.nan
    for rules in (DROPS, HAMMER):
        found = judged(force, rules)
        assert [len(hit.contacts) for hit in found] == [1, 1]
        assert [hit.defect[:36] for hit in found] == ["has 3 missing samples in its contact", ""]


def test_files_of_single_hits_are_paired_by_their_order():
    force = train((0.1, 1.0))
    motion = replace(force, quantity="acceleration")
    found = split_hits([force, force, motion, motion], HAMMER_SCENE)
    assert [one.hit for one in found] == [1, 2, 1, 2]
    assert found[0].measurement.clock == found[2].measurement.clock != found[1].measurement.clock
    with pytest.raises(RecordError, match="double hit"):
        split_hits([train((0.1, 1.0), (0.12, 1.0), (0.4, 1.0), (0.42, 1.0))], HAMMER_SCENE)


def test_modes_take_every_hit_from_10_ms_before_it():
    """A weaker hit is a hit, and two contacts within 0.1 s are one excitation."""
    found = find_hits(train((0.1, 1.0), (0.18, 0.6), (0.5, 0.1)), EXCITATION)
    assert [len(hit.contacts) for hit in found] == [2, 1]
    assert [hit.samples_before for hit in found] == [found[0].first, 512]
    assert found[0].samples.stop == found[1].samples.start


def test_a_double_hit_alone_in_its_record_is_used_and_noted():
    [one] = split_hits([train((0.1, 1.0), (0.11, 0.5))], HAMMER_SCENE)
    assert one.notes[0].startswith(
        "train.csv is a double hit: a second contact follows after 10 ms"
    )
    assert len(one.value) == RATE_HZ


def test_each_record_keeps_its_notes_at_the_first_hit():
    force = replace(train((0.1, 1.0), (0.3, 1.0)), notes=("of the force",))
    motion = replace(force, name="a", quantity="acceleration", notes=("of the motion",))
    clock = replace(force.measurement, clock="both")
    found = split_hits([replace(one, measurement=clock) for one in (force, motion)], HAMMER_SCENE)
    assert [one.hit for one in found] == [1, 1, 2, 2]
    assert [len(one.notes) for one in found] == [3, 1, 0, 0]


def test_the_onset_is_the_first_sample_above_the_noise():
    for noise in (0.0, 1e-3, 0.05):
        force = train((0.1, 1.0), noise=noise).value
        onset = find_onset(force, noise_after(force))
        assert 0 < onset - 0.1 * RATE_HZ < 1 + RATE_HZ * 1e-3 * np.arcsin(5 * noise + 0.02) / np.pi
