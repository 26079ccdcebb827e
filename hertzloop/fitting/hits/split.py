"""Split records of several hits into records of one hit each."""

from collections.abc import Sequence
from dataclasses import replace

from hertzloop.fitting.hits.find import DROPS, HAMMER, Hit, find_hits
from hertzloop.fitting.hits.judge import describe_hits, double_hit, judge_hits
from hertzloop.fitting.hits.numbering import group_by_clock, number_hits
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.quantities import GAP_QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup


def cut_hit(record: Record, hit: Hit, number: int) -> Record:
    """Return the samples of a record that belong to a hit; `number` becomes a part of its name."""
    return replace(
        record,
        name=f"{record.name}, hit {number}",
        time_s=record.time_s[hit.samples],
        value=record.value[hit.samples],
        hit=number,
    )


def split_hits(records: Sequence[Record], setup: Setup) -> list[Record]:
    """Return the records with one hit each, and the number of the hit of a hammer.

    The channels of a clock are split where their contact force has several hits. Of records without
    a clock the first one of each quantity is the first hit of a hammer, and so on.

    Raises:
        RecordError: none of several hits can be used.
    """
    hammer = setup.scene.hammer
    rules = DROPS if hammer is None or hammer.bounces else HAMMER
    found: list[Record] = []
    for channels in group_by_clock(records):
        force = next((one for one in channels if one.quantity == "contact_force"), None)
        if force is None:
            found += channels
            continue
        others = [
            one for one in channels if one is not force and one.quantity not in GAP_QUANTITIES
        ]
        hits = judge_hits(find_hits(force, rules), force, others, rules)
        if len(hits) > 1:
            found += _usable_hits(channels, force, hits)
            continue
        defect = double_hit(hits[0], force) if hits and rules.one_contact else ""
        notes = (*force.notes, f"{force.name} {defect}") if defect else force.notes
        found += [replace(one, notes=notes) if one is force else one for one in channels]
    several = any(one.hit for one in found)
    return number_hits(found) if hammer is not None or several else found


def _usable_hits(channels: Sequence[Record], force: Record, hits: Sequence[Hit]) -> list[Record]:
    """Return the channels of each hit that can be used. The first one notes what became of all
    hits. Raises RecordError if there is none."""
    notes = tuple(describe_hits(hits, force))
    if all(hit.defect for hit in hits):
        raise RecordError(" ".join(notes))
    found: list[Record] = []
    usable = [number for number, hit in enumerate(hits, 1) if not hit.defect]
    for number in usable:
        for channel in channels:
            clock = f"{channel.measurement.clock or channel.name}, hit {number}"
            found.append(
                replace(
                    cut_hit(channel, hits[number - 1], number),
                    measurement=replace(channel.measurement, clock=clock),
                    notes=channel.notes if number == usable[0] else (),
                )
            )
    return [replace(found[0], notes=(*found[0].notes, *notes)), *found[1:]]
