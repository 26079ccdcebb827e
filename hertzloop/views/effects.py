"""The effects that a run neglects: sentences, warnings and a table."""

import math
from collections.abc import Iterable

from rich.text import Text

from hertzloop.common.readable import percent
from hertzloop.results.effect_rows import OF_PLATE, ROWS
from hertzloop.results.effects import EffectState, Neglected, ValidityCheck
from hertzloop.views.format import Table, unwrapped

_MOST_WARNINGS = 8  # lines of neglected effects on the screen; --details prints all
OUT_OF_RANGE = "OUT OF RANGE:"  # the first words of a verdict on a run beyond its model
_HEADS = {
    EffectState.OUT_OF_RANGE: (OUT_OF_RANGE, "bold red"),
    EffectState.LEFT_OUT: ("Neglected:", "yellow"),
    EffectState.NOT_KNOWN: ("Unknown:", "yellow"),
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


def _outside(found: Iterable[ValidityCheck]) -> list[tuple[str, str, ValidityCheck]]:
    """Return each effect outside its limit with head and style, effects out of range first."""
    checks = list(found)
    return [(*_HEADS[state], check) for state in _HEADS for check in checks if check.state == state]


def sentences_of(found: Iterable[ValidityCheck]) -> list[tuple[str, str]]:
    """Return heads and sentences on effects out of range, neglected effects and unknown ones."""
    return [(head, f"{check.sentence}.") for head, _, check in _outside(found)]


def neglected_lines(found: Iterable[ValidityCheck]) -> list[Text]:
    """Return a sentence on each effect that is out of range, neglected or unknown."""
    return [
        unwrapped((head, style), f" {check.sentence}.") for head, style, check in _outside(found)
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


def out_of_range(found: Iterable[ValidityCheck]) -> list[str]:
    """Return one sentence on all effects out of range, the first of a verdict; none without one."""
    listed = [_brief(check) for check in found if check.state == EffectState.OUT_OF_RANGE]
    return [f"{OUT_OF_RANGE} {'; '.join(listed)}."] if listed else []


def warning_lines(found: Iterable[ValidityCheck]) -> list[Text]:
    """Return one line for each effect that is neglected or unknown, at most eight; those out of
    range are in the verdict."""
    lines = [
        Text.assemble((head, style), f" {_brief(check)}.")
        for head, style, check in _outside(found)
        if head != OUT_OF_RANGE
    ]
    if len(lines) > _MOST_WARNINGS:
        more = f"{len(lines) - _MOST_WARNINGS} more warnings: --details prints them."
        lines[_MOST_WARNINGS:] = [Text(more)]
    return lines


def _brief(check: ValidityCheck) -> str:
    """Return the size of an effect, and the key that models it; the sentence on an unknown one."""
    text, key = _BRIEF[check.name]
    if math.isnan(check.value):
        return check.sentence
    words = text.format(x=check.value, p=percent(check.value))
    return f"{words} ({key})" if key else words
