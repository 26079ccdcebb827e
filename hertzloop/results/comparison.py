"""Figures of two runs side by side, and by how much they differ."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.text import Text

from hertzloop.commands.terminal import Table
from hertzloop.results.spans import DECIBELS, RunFigures, SpanFigures, decibels

_SPANS = {"first_impact": "first impact", "whole_run": "whole run"}
# Words, factor and unit of a figure.
_SHOWN = {
    "contacts": ("contacts", 1.0, ""),
    "contact_time_s": ("contact time, first contact", 1e6, "us"),
    "impact_speed_m_s": ("impact speed", 1.0, "m/s"),
    "rebound_speed_m_s": ("rebound speed", 1.0, "m/s"),
    "rebound_height_m": ("rebound height", 1e3, "mm"),
    "peak_force_n": ("peak force", 1.0, "N"),
    "plate_energy_j": ("plate energy", 1e6, "uJ"),
    "plate_speed_max_m_s": ("largest plate speed", 1.0, "m/s"),
    "radiated_j": ("sigma E to 20 kHz, eq. 3.12 (study)", 1e6, "uJ"),
    "sound_j": ("radiated to 20 kHz, eq. 3.12", 1e6, "uJ"),
    "longhorn_j": ("acceleration noise, Longhorn", 1e6, "uJ"),
    "holmes_j": ("acceleration noise, Holmes", 1e6, "uJ"),
    "peak_pressure_pa": ("peak pressure bound at 1 m", 1.0, "Pa"),
}


@dataclass(frozen=True)
class Difference:
    """One figure of two runs, SI units: `b_to_a` in `unit`, "dB" of energies and amplitudes, "%"
    of other quantities, "" of a count. It is nan where no ratio is defined."""

    span: str
    figure: str
    a: float
    b: float
    b_to_a: float
    unit: str


@dataclass(frozen=True)
class Comparison:
    """All figures of two runs: those of the first impact, then those of the whole run."""

    rows: tuple[Difference, ...]

    def __str__(self) -> str:
        console = Console(width=100)
        with console.capture() as caught:
            console.print(table(self))
        return caught.get()


def compared(a: RunFigures, b: RunFigures) -> Comparison:
    """Compare the spans that both runs have."""
    return Comparison(tuple(_rows(a, b)))


def _rows(a: RunFigures, b: RunFigures) -> Iterator[Difference]:
    for span in _SPANS:
        one, other = getattr(a, span), getattr(b, span)
        if one is None or other is None:
            continue
        for figure in _SHOWN:
            yield _difference(span, figure, getattr(one, figure), getattr(other, figure))


def _difference(span: str, figure: str, a: float, b: float) -> Difference:
    if figure in DECIBELS:
        return Difference(span, figure, a, b, decibels(b, a, DECIBELS[figure]), "dB")
    if figure == "contacts":
        return Difference(span, figure, a, b, b - a, "")
    change = 100.0 * (b / a - 1.0) if a else float("nan")
    return Difference(span, figure, a, b, change, "%")


def figures_in(report: Mapping[str, Any]) -> RunFigures:
    """The figures in what `run --json` or `inspect --json` writes."""
    spans = {span: report[span] and SpanFigures(**report[span]) for span in _SPANS}
    return RunFigures(**spans)


def as_json(found: Comparison) -> list[dict[str, Any]]:
    """For --json: a dictionary for each figure, with fields as in `Difference`."""
    return [asdict(row) for row in found.rows]


def table(found: Comparison) -> Table:
    """The figures of both runs with their units, and the change from A to B."""
    shown = Table(title="Figures of A and B, and the change from A to B")
    shown.add_column("figure")
    for heading in ("A", "B", "change"):
        shown.add_column(heading, justify="right")
    span = ""
    for row in found.rows:
        if row.span != span:
            span = row.span
            shown.add_section()
            shown.add_row(Text(_SPANS[span], style="bold"), "", "", "")
        words, factor, unit = _SHOWN[row.figure]
        values = [_number(value, factor, unit) for value in (row.a, row.b)]
        shown.add_row(words, *values, _change(row))
    return shown


def _number(value: float, factor: float, unit: str) -> str:
    return "not defined" if value != value else f"{value * factor:.4g} {unit}".strip()


def _change(row: Difference) -> str:
    if row.b_to_a != row.b_to_a:
        return ""
    return f"{row.b_to_a:+z.2f} {row.unit}" if row.unit else f"{row.b_to_a:+z.0f}"
