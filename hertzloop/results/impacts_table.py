"""The table of a run's impacts, each number with the digits that it has."""

import math
from collections.abc import Iterable
from typing import Any

from rich.table import Table

from hertzloop.results.predictability import CHAOTIC

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


def impacts_table(
    title: str,
    impacts: list[dict[str, float]],
    known: list[dict[str, Any]] | None = None,
    recorded: bool = False,
) -> Table:
    """Impacts, one a row; `known` as `predictability.Known`: an impact that depends chaotically
    on those before it has the digits that are left, and none are shown once there are none.
    `recorded`: nothing is known of that, as the run is not made again."""
    table = Table(title=title, title_justify="left")
    to_unit, unit = energy_unit(impact["plate_energy_j"] for impact in impacts[:_SHOWN])
    for heading, *_ in _COLUMNS:
        table.add_column(heading.format(unit=unit), justify="right")
    notes, rows = [], impacts[:_SHOWN]
    for i, impact in enumerate(rows):
        errors: dict[str, float] = {}
        if known is not None and not known[i]["amplification"] <= CHAOTIC:
            errors = known[i]["errors"]
        cells = [
            known_digits(
                impact[key] * (factor or to_unit), form, errors.get(key, 0.0) * (factor or to_unit)
            )
            for _, key, factor, form in _COLUMNS
        ]
        if all(cell == "?" for cell in cells):
            notes.append(f"{len(impacts) - i} more follow, of which nothing can be known")
            break
        table.add_row(*cells)
    else:
        if len(impacts) > _SHOWN:
            notes.append(f"and {len(impacts) - _SHOWN} more; --json has them all")
    if known is not None and any(not k["amplification"] <= CHAOTIC for k in known[: len(rows)]):
        grown = known[min(1, len(known) - 1)]["amplification"]
        notes.append(
            "digits as far as the model's error leaves any: "
            f"the second impact magnifies it {grown:.2g} times"
        )
    if recorded and len(impacts) > 1:
        notes.append("digits as recorded: 'hertzloop run' tells how many later impacts have")
    table.caption = "; ".join(notes) or None
    return table


def energy_unit(energies_j: Iterable[float]) -> tuple[float, str]:
    """Return the factor from J and the unit in which four digits of energies need no exponent."""
    large = max((abs(energy) for energy in energies_j), default=0.0) >= 1e-2
    return (1e3, "mJ") if large else (1e6, "uJ")


def known_digits(value: float, form: str, error: float) -> str:
    """A number as formatted, or with as many digits as an error leaves; ? without any."""
    usual = f"{value:{form}}"
    if error == 0.0:
        return usual
    if not error < abs(value):
        return "?"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error))
    # `#` keeps the zeros that are known.
    known = f"{value:#.{max(digits, 1)}g}".replace(".e", "e").removesuffix(".")
    return min(known, usual, key=lambda text: sum(c.isdigit() for c in text.partition("e")[0]))
