"""Names that instruments give to facts beside a table: sampling interval, rate, start, units."""

from collections.abc import Collection


def is_one_of(name: str, names: Collection[str]) -> bool:
    """Whether a plain name is one of some, with or without underscores."""
    return name.replace("_", "") in {one.replace("_", "") for one in names}


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
