"""What a scene key changes: the drop, the force of the actuator, or the measuring chain."""

from collections.abc import Mapping

from hertzloop.fitting.records.chain_keys import is_chain_key
from hertzloop.fitting.records.record import Record


def is_control_key(key: str) -> bool:
    """Whether a key changes nothing but the force of the actuator."""
    table, _, last = key.partition(".")
    return table == "controller" or (table == "actuator" and last != "mass_kg")


def drop_values(values: Mapping[str, float]) -> dict[str, float]:
    """Return the scene keys that a drop without control depends on."""
    return {k: v for k, v in values.items() if not (is_chain_key(k) or is_control_key(k))}


def values_for_record(values: Mapping[str, float], record: Record) -> dict[str, float]:
    """Return the scene keys that concern a record.

    Keys that its table sets are left out.
    """
    return {key: value for key, value in values.items() if key not in record.measurement.set}
