"""Choose the series of a file that is the record."""

from hertzloop.fitting.records.contents import (
    FileContents,
    Series,
    is_series,
)
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.quantities import quantity_of


def choose_series(contents: FileContents, measurement: Measurement) -> tuple[Series, list[str]]:
    """Return the series that is the record, and notes.

    Raises:
        RecordError: none is of a known quantity, or several could be the record.
    """
    name, every = contents.name, [s for s in contents.series if not s.is_time]
    left = every
    for key in ("group", "channel", "column"):
        if getattr(measurement, key) is not None:
            left = _chosen_by(key, getattr(measurement, key), left, contents)
    explicit = measurement.channel is not None or measurement.column is not None
    if measurement.quantity is None and not explicit:
        left = [s for s in left if quantity_of(s.name)]
    elif len(left) > 1:
        left = [s for s in left if quantity_of(s.name) == measurement.quantity] or left
    if not left:
        raise RecordError(
            f"{name}: no column is a known quantity; the columns are "
            f"{contents.describe(*contents.series)}. Name a column "
            "such as contact_force_n or v_p_m_s, or give record.quantity and record.column. "
            f"{' '.join(contents.notes)}".strip()
        )
    alike = [s for s in left if quantity_of(s.name) == quantity_of(left[0].name)]
    if len(alike) > 1:
        key = "group" if len({s.group for s in alike}) == len(alike) else contents.kind
        key = "channel" if key == "data set" else key
        value = f'"{alike[0].group}"' if key == "group" else alike[0].number
        raise RecordError(
            f"{name}: {len(alike)} series could be the record: "
            f"{contents.describe(*alike)}. Choose one, for example "
            f"with record.{key} = {value}."
        )
    others = [s.name or str(s.number) for s in every if s is not left[0]]
    if explicit or not others:
        return left[0], []
    are = "is" if len(others) == 1 else "are"
    return left[0], [
        f"{name}: {contents.kind} {left[0].name} is used, and {', '.join(others)} {are} not. "
        "Choose with record.column."
    ]


def _chosen_by(
    key: str, said: str | int, series: list[Series], contents: FileContents
) -> list[Series]:
    """Return the series that a key of the `[record]` table means. Raises RecordError if none is
    meant."""
    if key == "group":
        groups = list(dict.fromkeys(s.group for s in contents.series if not s.is_time))
        wanted = groups[said - 1] if isinstance(said, int) and 0 < said <= len(groups) else said
        kept = [s for s in series if s.group == str(wanted)]
    elif key == "channel" and isinstance(said, int) and contents.kind == "column":
        kept = series[said - 1 : said] if said > 0 else []
    else:
        exact = [s for s in series if s.name == said]
        kept = exact or [s for s in series if is_series(s, said)]
    if not kept:
        raise RecordError(
            f"record.{key} = {said!r}: not a {key} of {contents.name}. It has "
            f"{contents.describe(*series)}."
        )
    return kept
