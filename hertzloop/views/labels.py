"""Units and meanings of the streams of a run, for exports and labelled arrays."""

from hertzloop.plant.time_series import TRUTH
from hertzloop.scene.quantities import SENSED

FORCE_LABEL = ("N", "force commanded of the actuator, up on the plate")
HELD = {"held_steps": ("", "by how many steps the command was too old, in a paced run")}


def sensed_label(quantity: str) -> tuple[str, str]:
    """Return unit and meaning of the samples of a quantity."""
    found = SENSED.get(quantity)
    return (found.unit, found.meaning) if found else ("", "sampled quantity")


def export_labels(quantity: str) -> dict[str, tuple[str, str]]:
    """Return unit and meaning of each column of an export, for the sensed quantity."""
    return TRUTH | {
        **HELD,
        "command_n": FORCE_LABEL,
        "daq_value": sensed_label(quantity),
        "daq_code": ("", "the converter's code of it"),
        "daq_saturated": ("", "1 where the converter was out of its range"),
    }
