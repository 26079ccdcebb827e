"""Names of columns that hold times, or the numbers of samples."""

import re

from hertzloop.fitting.records.units import name_and_unit, plain_name, unit_of

SAMPLE_NUMBERS = frozenset(
    {
        "",
        "sample",
        "samples",
        "sequence",
        "index",
        "n",
        "no",
        "nr",
        "number",
        "point",
        "points",
        "row",
        "i",
        "idx",
        "step",
        "sample_number",
        "sample_no",
        "unnamed_0",
    }
)
TIMES = frozenset(
    {
        "time",
        "t",
        "timestamp",
        "datetime",
        "date",
        "x",
        "x_axis",
        "xaxis",
        "x_value",
        "x_values",
        "elapsed",
        "elapsed_time",
        "relative_time",
        "absolute_time",
        "time_axis",
        "time_stamp",
        "date_time",
        "time_of_day",
    }
)


def is_time(heading: str, unit: str = "") -> bool:
    """Whether a column holds times, by its heading and the unit beside it."""
    name, own = name_and_unit(heading, TIMES)
    stated = unit_of(own or unit)
    if stated is not None:
        return stated.si == "s" and plain_name(heading) != "xi_s"
    if unit and plain_name(unit) in SAMPLE_NUMBERS:
        return False
    plain = plain_name(name)
    return plain in TIMES or re.sub(r"_?\d+$", "", plain) in TIMES - {"x", "t"}
