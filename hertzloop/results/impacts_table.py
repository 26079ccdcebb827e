"""The table of a run's impacts, each number with the digits that it has."""

from collections.abc import Iterable
from typing import Any

from hertzloop.commands.terminal import Table
from hertzloop.results.digits import LEGEND, UNKNOWN, about, known_digits
from hertzloop.results.predictability import errors_of, is_chaotic

_SHOWN = 12  # impacts in a table; --json has them all
# Heading, key, factor and usual format.
_COLUMNS = (
    ("start (ms)", "start_s", 1e3, ".4f"),
    ("duration (us)", "duration_s", 1e6, ".2f"),
    ("impact (m/s)", "impact_speed_m_s", 1.0, ".4f"),
    ("rebound (m/s)", "rebound_speed_m_s", 1.0, ".4f"),
    ("peak force (N)", "peak_force_n", 1.0, ".4g"),
    ("into the plate ({unit})", "plate_energy_j", 0.0, ".4g"),  # factor: see `energy_unit`
    ("plate, at most (m/s)", "plate_speed_max_m_s", 1.0, ".4g"),
)


def headings(impacts: list[dict[str, float]]) -> list[str]:
    """Return the headings of the columns, with the unit that suits the energies."""
    _, unit = energy_unit(impact["plate_energy_j"] for impact in impacts[:_SHOWN])
    return [heading.format(unit=unit) for heading, *_ in _COLUMNS]


def impacts_table(
    title: str,
    impacts: list[dict[str, float]],
    known: list[dict[str, Any]] | None = None,
    why_not: str = "",
) -> Table:
    """Impacts, one a row; see `impact_rows`."""
    table = Table(title=title)
    for heading in headings(impacts):
        table.add_column(heading, justify="right")
    rows, notes = impact_rows(impacts, known, why_not)
    for row in rows:
        table.add_row(*row)
    table.caption = "; ".join(notes) or None
    return table


def energy_unit(energies_j: Iterable[float]) -> tuple[float, str]:
    """Return the factor from J and the unit in which four digits of energies need no exponent."""
    large = max((abs(energy) for energy in energies_j), default=0.0) >= 1e-2
    return (1e3, "mJ") if large else (1e6, "uJ")


def impact_rows(
    impacts: list[dict[str, float]], known: list[dict[str, Any]] | None = None, why_not: str = ""
) -> tuple[list[list[str]], list[str]]:
    """Rows of the table below `headings`, and notes on them.

    Args:
        impacts: Fields as in `Impact`.
        known: Fields as in `Known`, one for each impact: one that depends chaotically on those
            before it has its predictable digits, and none are listed once there are none.
        why_not: Why nothing is known of the digits, where that is so.
    """
    rows: list[list[str]] = []
    notes: list[str] = []
    to_unit, _ = energy_unit(impact["plate_energy_j"] for impact in impacts[:_SHOWN])
    for i, impact in enumerate(impacts[:_SHOWN]):
        errors = errors_of(known, i)
        cells = [
            known_digits(
                impact[key] * (factor or to_unit), form, errors.get(key, 0.0) * (factor or to_unit)
            )
            for _, key, factor, form in _COLUMNS
        ]
        if all(cell == UNKNOWN for cell in cells):
            notes.append(f"impacts from number {i + 1} on are not predictable")
            break
        rows.append(cells)
    else:
        if len(impacts) > _SHOWN:
            notes.append(f"and {len(impacts) - _SHOWN} more; --json has them all")
    if known is not None and any(map(is_chaotic, known[: len(rows)])):
        grown = known[min(1, len(known) - 1)]["amplification"]
        notes.insert(
            0,
            "only predictable digits are shown: the second impact magnifies the model's error "
            f"{about(grown)} times",
        )
        if any(UNKNOWN in row for row in rows):
            notes.append(LEGEND)
    if why_not and len(impacts) > 1:
        notes.append(
            "digits as recorded: how many are predictable after the first impact is not known, "
            f"since {why_not}"
        )
    return rows, notes
