"""The effects that a run neglects on the terminal and as JSON."""

import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from rich.console import Console

from hertzloop.analysis.effects import OF_PLATE, ROWS, EffectState, Neglected, percent
from hertzloop.views.format import Table, styled


def not_evaluated(neglected: Neglected) -> str:
    """Return which effects have no size in this structure, in a sentence; empty if all have one."""
    if neglected.facts is None or neglected.facts.local is not None:
        return ""
    return (
        f"Not evaluated: {', '.join(OF_PLATE)}. No plate at the contact point is known for "
        f"{neglected.facts.spec.plate}; for a file of modes, plate.thickness_m gives one."
    )


def effects_as_json(neglected: Neglected) -> dict[str, Any]:
    """`validity`: all effects, fields as in `Finding`; `warnings`: sentences on those out of
    range."""
    shown = [asdict(found) for found in neglected.findings]
    beyond = [one for one in shown if one["state"] == EffectState.OUT_OF_RANGE]
    return {"validity": shown, "warnings": [f"{one['name']}: {one['sentence']}" for one in beyond]}


_HEADS = {
    EffectState.OUT_OF_RANGE: ("OUT OF RANGE:", "bold red"),
    EffectState.LEFT_OUT: ("Neglected:", "yellow"),
}
_STATE_WORDS = {EffectState.LEFT_OUT: "neglected", EffectState.NOT_KNOWN: "unknown"}
_BRIEF = {row.name: (row.brief or row.name, row.key) for row in ROWS}


def sentences_of(found: Iterable[dict[str, Any]]) -> list[tuple[str, str]]:
    """Heads and sentences on effects out of range, then on neglected effects."""
    return [(head, sentence) for head, _, sentence in _styled_sentences(found)]


def _styled_sentences(found: Iterable[dict[str, Any]]) -> list[tuple[str, str, str]]:
    known = list(found)
    return [
        (*_HEADS[state], f"{f['sentence']}.")
        for state in _HEADS for f in known if f["state"] == state
    ]  # fmt: skip


def brief_warnings(found: Iterable[dict[str, Any]]) -> list[tuple[str, str, str]]:
    """Render each effect outside its limit on one line of at most 80 columns.

    Args:
        found: The indicators, as `effects_as_json` writes them.

    Returns:
        Head, style and text of each line: effects out of range first, then neglected ones.
    """
    known = list(found)
    lines = []
    for state, (head, style) in _HEADS.items():
        for one in known:
            if one["state"] != state:
                continue
            text, key = _BRIEF[one["name"]]
            if math.isnan(one["value"]):
                text = one["name"]
            words = text.format(x=one["value"], p=percent(one["value"]))
            lines.append((head, style, f"{words} ({key})." if key else f"{words}."))
    return lines


def show_neglected(console: Console, found: Iterable[dict[str, Any]]) -> None:
    """Print a sentence on each neglected effect."""
    for head, style, sentence in _styled_sentences(found):
        console.print(styled((head, style), f" {sentence}"), soft_wrap=True)


def table_of(found: Iterable[dict[str, Any]]) -> Table:
    """All indicators with their thresholds."""
    table = Table(title="Neglected effects")
    for heading in ("effect", "formula", "value", "threshold", ""):
        table.add_column(heading, justify="right" if heading in ("value", "threshold") else "left")
    for finding in found:
        value = finding["value"]
        falls = finding["beyond"] < finding["threshold"]
        _, style = _HEADS.get(finding["state"], ("", ""))
        table.add_row(
            finding["name"], finding["formula"], "" if math.isnan(value) else f"{value:.2g}",
            f"{'>' if falls else '<'} {finding['threshold']:.2g}",
            styled((_STATE_WORDS.get(finding["state"], finding["state"]), style)),
        )  # fmt: skip
    return table
