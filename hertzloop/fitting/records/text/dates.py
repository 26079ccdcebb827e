"""Dates and times of day in cells."""

import datetime
import functools
import re
from typing import NamedTuple

from hertzloop.fitting.records.errors import TableError, shorten

_DATE = re.compile(
    r"(?:(\d{1,4})([-/.])(\d{1,2})\2(\d{1,4})(?:[T ,]+|$))?"
    r"(?:(\d{1,2}):(\d\d)(?::(\d\d(?:[.,]\d+|:\d{3,})*))?|(\d{1,2}):(\d\d[.,]\d+))?"
    r"\s*([AaPp][Mm])?\s*(Z|[+-]\d\d:?\d\d)?"
)


class DateOrTime(NamedTuple):
    """A date, a time of day, or both.

    Attributes:
        day: number of the day; None of a time of day. Dates that can mean two days have numbers
            that tell equal ones from others only.
        minutes_s: seconds of the day up to the minute.
        seconds: of the minute.
        sure: whether the order of day and month is known.
    """

    day: int | None
    minutes_s: int
    seconds: float
    sure: bool


class DateColumn:
    """Seconds of dates and times of day, from the minute of the first one on."""

    def __init__(self) -> None:
        self._first: tuple[int, int] | None = None  # day, and seconds of its whole minutes
        self._known: dict[str, float] = {}  # seconds of the text before the last colon
        self._dates: set[str] = set()  # dates that can mean two days

    def seconds(self, cell: str) -> float:
        """Return the seconds of a cell. Raises TableError for dates that can mean two days."""
        head, colon, tail = cell.rpartition(":")
        base = self._known.get(head) if colon else None
        if base is not None:
            try:
                return base + float(tail)
            except ValueError:
                pass
        found = parse_date_or_time(cell)
        if found is None:
            raise ValueError(cell)
        date, minutes_s, seconds, sure = found
        if date is not None:
            self._dates.add(cell[:8] if not sure else "")
            if len(self._dates) > 1:
                raise TableError(
                    f"the date changes in the table, and '{shorten(cell)}' may name the day or the "
                    "month first. Write dates as 2024-12-31"
                )
        self._first = self._first or (date or 0, minutes_s)
        total = 86400 * ((date or 0) - self._first[0]) + minutes_s - self._first[1] + seconds
        if colon and re.fullmatch(r"\d\d(\.\d+)?", tail) and head.count(":") == 1:
            self._known[head] = total - float(tail)
        return total


@functools.lru_cache(maxsize=1 << 10)
def parse_date_or_time(cell: str) -> DateOrTime | None:
    """Return what a cell says; None if it is neither a date nor a time of day nor a duration."""
    days = re.match(r"(\d+) days?,?\s*", cell)  # a duration
    if days:
        rest = parse_date_or_time(cell[days.end() :] or "0:00")
        if rest is None or rest.day is not None:
            return None
        return DateOrTime(int(days[1]), rest.minutes_s, rest.seconds, True)
    found = _DATE.fullmatch(cell)
    if found is None or not cell or not (found[1] or found[5] or found[8]):
        return None
    day: int | None = None
    sure = True
    if found[1]:
        a, b, c = int(found[1]), int(found[3]), int(found[4])
        sure = len(found[1]) == 4
        try:
            if sure:
                day = datetime.date(a, b, c).toordinal()
            elif b > 12:
                day = datetime.date(c, a, b).toordinal()
            else:
                day = datetime.date(c, b, a).toordinal() if a > 12 else a + 31 * b + 372 * c
        except ValueError:
            return None
    if found[8]:
        return DateOrTime(day, 60 * int(found[8]), float(found[9].replace(",", ".")), sure)
    if not found[5]:
        return DateOrTime(day, 0, 0.0, sure)
    whole, *parts = re.split("[.,:]", found[7] or "0")
    hour = int(found[5])
    if found[10]:
        hour = hour % 12 + 12 * (found[10].lower() == "pm")
    seconds = float(f"{whole}.{''.join(parts) or 0}")
    return DateOrTime(day, 3600 * hour + 60 * int(found[6]), seconds, sure)
