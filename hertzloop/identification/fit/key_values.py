"""Which scene keys concern a record."""

from collections.abc import Mapping

from hertzloop.identification.fit.control_keys import is_control_key
from hertzloop.identification.records.chain_keys import is_chain_key
from hertzloop.identification.records.record import Record


def values_for_record(values: Mapping[str, float], record: Record) -> dict[str, float]:
    """Return the scene keys that concern a record.

    Keys that its table sets are left out. Of the keys `KEY[HIT]` the one of its hit is returned,
    as KEY.
    """
    found = {}
    for key, value in values.items():
        name, _, hit = key.partition("[")
        if name not in record.measurement.set and hit in ("", f"{record.hit}]"):
            found[name] = value
    return found


def ignored_without_control(key: str) -> bool:
    """Return whether a drop without control does not depend on a key."""
    return is_chain_key(key) or is_control_key(key)
