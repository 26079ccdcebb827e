"""The effects that a run neglects: sentences, warnings and a table."""

import math
from collections.abc import Iterable

from rich.text import Text

from hertzloop.results.effect_rows import OF_PLATE, ROWS
from hertzloop.results.effects import EffectState, Neglected, ValidityCheck
from hertzloop.results.rounding import percent
from hertzloop.views.format import Table, unwrapped

_MOST_WARNINGS = 8  # lines of neglected effects on the screen; --details prints all
_HEADS = {
    EffectState.OUT_OF_RANGE: ("OUT OF RANGE:", "bold red"),
    EffectState.LEFT_OUT: ("Neglected:", "yellow"),
}

_STATE_WORDS = {EffectState.LEFT_OUT: "neglected", EffectState.NOT_KNOWN: "unknown"}

_BRIEF = {row.name: (row.brief or row.name, row.key) for row in ROWS}


def not_evaluated(neglected: Neglected) -> str:
    """Return which effects have no size in this structure, in a sentence; empty if all have one."""
    if neglected.context is None or neglected.context.local is not None:
        return ""
    return (
        f"Not evaluated: {', '.join(OF_PLATE)}. No plate at the contact point is known for "
        f"{neglected.context.spec.plate}; for a file of modes, plate.thickness_m gives one."
    )


def sentences_of(found: Iterable[ValidityCheck]) -> list[tuple[str, str]]:
    """Return heads and sentences on effects out of range, then on neglected effects."""
    return [(head, sentence) for head, _, sentence in _styled_sentences(found)]


def _styled_sentences(found: Iterable[ValidityCheck]) -> list[tuple[str, str, str]]:
    """Return head, style and sentence of each effect, effects out of range first."""
    checks = list(found)
    return [
        (*_HEADS[state], f"{check.sentence}.")
        for state in _HEADS
        for check in checks
        if check.state == state
    ]


def brief_warnings(found: Iterable[ValidityCheck]) -> list[tuple[str, str, str]]:
    """Render each effect outside its limit on one line of at most 80 columns.

    Args:
        found: The checks of a run.

    Returns:
        Head, style and text of each line: effects out of range first, then neglected ones.
    """
    known = list(found)
    lines = []
    for state, (head, style) in _HEADS.items():
        for one in known:
            if one.state != state:
                continue
            text, key = _BRIEF[one.name]
            if math.isnan(one.value):
                text = one.name
            words = text.format(x=one.value, p=percent(one.value))
            lines.append((head, style, f"{words} ({key})." if key else f"{words}."))
    return lines


def neglected_lines(found: Iterable[ValidityCheck]) -> list[Text]:
    """Return a sentence on each effect that is neglected or out of range."""
    return [
        unwrapped((head, style), f" {sentence}")
        for head, style, sentence in _styled_sentences(found)
    ]


def table_of(found: Iterable[ValidityCheck]) -> Table:
    """Return the table of all effects with their thresholds."""
    table = Table(title="Neglected effects")
    for heading in ("effect", "formula", "value", "threshold", ""):
        table.add_column(heading, justify="right" if heading in ("value", "threshold") else "left")
    for one in found:
        _, style = _HEADS.get(one.state, ("", ""))
        table.add_row(
            one.name,
            one.formula,
            "" if math.isnan(one.value) else f"{one.value:.2g}",
            f"{'>' if one.beyond < one.threshold else '<'} {one.threshold:.2g}",
            Text(_STATE_WORDS.get(one.state, one.state), style),
        )
    return table


def warning_lines(found: Iterable[ValidityCheck]) -> list[Text]:
    """Return one line for each effect outside its limit, at most eight."""
    known = brief_warnings(found)
    lines = [Text.assemble((head, style), f" {words}") for head, style, words in known]
    if len(lines) > _MOST_WARNINGS:
        more = f"{len(lines) - _MOST_WARNINGS} more warnings: --details prints them."
        lines[_MOST_WARNINGS:] = [Text(more)]
    return lines
