"""The table of impacts: one row for each impact, with its predictable digits."""

from collections.abc import Sequence

from hertzloop.results.predictability import ImpactErrors, errors_of
from hertzloop.results.span_metrics import SPAN_FACTS, Values
from hertzloop.views.digits import LEGEND, UNKNOWN, about, known_digits
from hertzloop.views.format import Table

_SHOWN = 12  # impacts in a table; --json has them all

# Label, key, factor, unit and usual format. Labels are those of the first impact.
_COLUMNS = (
    ("start", "start_s", 1e3, "ms", ".4f"),
    *(
        (SPAN_FACTS[name].label, key, factor, unit, form)
        for name, key, factor, unit, form in (
            ("contact_time_s", "duration_s", 1e6, "us", ".2f"),
            ("impact_speed_m_s", "impact_speed_m_s", 1.0, "m/s", ".4f"),
            ("rebound_speed_m_s", "rebound_speed_m_s", 1.0, "m/s", ".4f"),
            ("peak_force_n", "peak_force_n", 1.0, "N", ".4g"),
            ("plate_energy_j", "plate_energy_j", 1e6, "uJ", ".4g"),
            ("plate_speed_max_m_s", "plate_speed_max_m_s", 1.0, "m/s", ".4g"),
        )
    ),
)


def impact_headings(impacts: Sequence[Values]) -> list[str]:
    """Return the headings of the columns, with the unit that suits the energies."""
    _, energy = _energy_unit(impacts)
    return [f"{label} ({energy if unit == 'uJ' else unit})" for label, _, _, unit, _ in _COLUMNS]


def _energy_unit(impacts: Sequence[Values]) -> tuple[float, str]:
    """Return the factor from J and the unit in which four digits of energies need no exponent."""
    large = max((abs(one["plate_energy_j"]) for one in impacts[:_SHOWN]), default=0.0) >= 1e-2
    return (1e3, "mJ") if large else (1e6, "uJ")


def impacts_table(
    title: str,
    impacts: Sequence[Values],
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
    impacts: Sequence[Values], digits: Sequence[ImpactErrors] | None = None, why_not: str = ""
) -> tuple[list[list[str]], list[str]]:
    """Return the rows of the table, without headings, and notes on them.

    Impacts without a predictable digit have no rows.

    Args:
        impacts: The metrics of each impact, as `values_of` has them.
        digits: Errors of each impact, which decide the digits that are printed.
        why_not: Why the errors are unknown, if they are; it follows "since".
    """
    rows: list[list[str]] = []
    notes: list[str] = []
    energy_factor, _ = _energy_unit(impacts)
    factors = [energy_factor if unit == "uJ" else factor for _, _, factor, unit, _ in _COLUMNS]
    for i, impact in enumerate(impacts[:_SHOWN]):
        errors = errors_of(digits, i)
        cells = [
            known_digits(impact[key] * factor, form, errors.get(key, 0.0) * factor)
            for (_, key, *_, form), factor in zip(_COLUMNS, factors, strict=True)
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
