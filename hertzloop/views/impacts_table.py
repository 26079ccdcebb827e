"""The table of impacts: one row for each impact, with its predictable digits."""

from collections.abc import Sequence

from hertzloop.plant.metrics.impacts import Impact
from hertzloop.results.predictability import ImpactErrors, errors_of
from hertzloop.views.digits import LEGEND, UNKNOWN, about, energy_unit, known_digits
from hertzloop.views.format import Table

_SHOWN = 12  # impacts in a table; --json has them all

# Heading, key, factor and usual format.
_COLUMNS = (
    ("start (ms)", "start_s", 1e3, ".4f"),
    ("duration (us)", "duration_s", 1e6, ".2f"),
    ("impact (m/s)", "impact_speed_m_s", 1.0, ".4f"),
    ("rebound (m/s)", "rebound_speed_m_s", 1.0, ".4f"),
    ("peak force (N)", "peak_force_n", 1.0, ".4g"),
    ("plate energy ({unit})", "plate_energy_j", 0.0, ".4g"),  # factor: see `energy_unit`
    ("plate speed (m/s)", "plate_speed_max_m_s", 1.0, ".4g"),
)


def impact_headings(impacts: Sequence[Impact]) -> list[str]:
    """Return the headings of the columns, with the unit that suits the energies."""
    _, unit = energy_unit(impact.plate_energy_j for impact in impacts[:_SHOWN])
    return [heading.format(unit=unit) for heading, *_ in _COLUMNS]


def impacts_table(
    title: str,
    impacts: Sequence[Impact],
    known: Sequence[ImpactErrors] | None = None,
    why_not: str = "",
) -> Table:
    """Return the table of impacts; see `impact_rows`."""
    table = Table(right=impact_headings(impacts), title=title)
    rows, notes = impact_rows(impacts, known, why_not)
    for row in rows:
        table.add_row(*row)
    table.caption = "; ".join(notes) or None
    return table


def impact_rows(
    impacts: Sequence[Impact], digits: Sequence[ImpactErrors] | None = None, why_not: str = ""
) -> tuple[list[list[str]], list[str]]:
    """Return the rows of the table, without headings, and notes on them.

    Impacts without a predictable digit have no rows.

    Args:
        impacts: The impacts.
        digits: Errors of each impact, which decide the digits that are printed.
        why_not: Why the errors are unknown, if they are; it follows "since".
    """
    rows: list[list[str]] = []
    notes: list[str] = []
    to_unit, _ = energy_unit(impact.plate_energy_j for impact in impacts[:_SHOWN])
    for i, impact in enumerate(impacts[:_SHOWN]):
        errors = errors_of(digits, i)
        cells = [
            known_digits(
                getattr(impact, key) * (factor or to_unit),
                form,
                errors.get(key, 0.0) * (factor or to_unit),
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
    if digits is not None and any(each.chaotic for each in digits[: len(rows)]):
        grown = digits[min(1, len(digits) - 1)].amplification
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
