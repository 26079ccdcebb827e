"""Names that instruments give to facts beside a table: sampling interval, rate, start, units."""

from collections.abc import Collection, Mapping, Sequence


def is_one_of(name: str, names: Collection[str]) -> bool:
    """Whether a plain name is one of some, with or without underscores."""
    return name.replace("_", "") in {one.replace("_", "") for one in names}


def stated_fact(facts: Mapping[str, Sequence[str]], names: Collection[str], place: int = 0) -> str:
    """Return a value of the first fact with one of the names; "" if there is none.

    Args:
        facts: cells of each fact, by its plain name.
        names: plain names, the first of which counts most.
        place: number of the cell, from 0 on; the last one if there are fewer.
    """
    for wanted in names:
        if cells := next((c for name, c in facts.items() if is_one_of(name, [wanted])), None):
            return cells[min(place, len(cells) - 1)].rpartition(":")[2]  # as in "CH1:V"
    return ""


# Facts beside a table that give its times and units: "Sample Interval", "Delta_X", "XAxisUnit".
INTERVAL_FACTS = (
    "sample_interval",
    "sampling_interval",
    "sample_period",
    "sampling_period",
    "delta_x",
    "x_increment",
    "xinc",
    "increment",
    "delta_t",
    "dt",
    "time_increment",
    "time_step",
    "sample_time",
    "horizontal_interval",
    "tinc",
    "hresolution",
    "x_axis_delta",
    "time_interval",
    "t_interval",
)
RATE_FACTS = (
    "sample_rate",
    "sampling_rate",
    "sampling_frequency",
    "sample_frequency",
    "samples_per_second",
    "rate",
    "fs",
    "sampling_rate_hz",
    "sample_rate_hz",
)
START_FACTS = (
    "start",
    "x0",
    "x_zero",
    "x_origin",
    "xorg",
    "x_axis_min",
    "x_start",
    "hoffset",
    "t0",
    "t_start",
)
TIME_UNIT_FACTS = (
    "horizontal_units",
    "x_units",
    "x_unit",
    "x_unit_label",
    "time_unit",
    "time_units",
    "horizontal_unit",
    "hunit",
    "x_axis_unit",
)
VALUE_UNIT_FACTS = (
    "vertical_units",
    "y_unit_label",
    "y_units",
    "y_unit",
    "units",
    "unit",
    "vertical_unit",
    "vunit",
    "y_axis_unit",
)
MULTIPLIER_FACTS = ("multiplier", "scale_factor", "scaling_factor", "factor")
STATED_FACTS = (
    *INTERVAL_FACTS,
    *RATE_FACTS,
    *START_FACTS,
    "date",
    "time",
    "length",
    "record_length",
    "points",
    "samples",
    "size",
    "block_size",
    "number_of_values",
)
