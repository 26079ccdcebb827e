"""What a run leaves out, in words: sentences of a run, the table of all indicators."""

import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.console import Console

from hertzloop.commands.terminal import Table, styled
from hertzloop.loop.compiled import simulate
from hertzloop.results.extremes import Extremes, ExtremesMeter
from hertzloop.results.facts import Facts
from hertzloop.results.impact_rows import impacts_of_rows
from hertzloop.results.stability import StabilityMeter
from hertzloop.results.validity import findings, warnings_of
from hertzloop.setup import Setup

_MOST_STEPS = 2_000_000  # that `validity` simulates in memory


def as_json(setup: Setup, run: Extremes) -> dict[str, Any]:
    """`validity`: all indicators, fields as in `Finding`; `warnings`: sentences on those that are
    out of range by far."""
    found = findings(Facts(setup, setup.plant, run))
    return {"validity": [asdict(f) for f in found], "warnings": warnings_of(found)}


def of_scene(setup: Setup) -> dict[str, Any]:
    """The same of a scene, simulated here, the beginning of a very long one; `stable` is false and
    there are no indicators where the loop explodes."""
    setup = setup.lasting(min(setup.steps, _MOST_STEPS))
    rows = simulate(setup).rows
    stability, extremes = StabilityMeter(setup), ExtremesMeter(setup.plant)
    stability.feed(0, rows)
    extremes.feed(rows)
    if stability.result().unstable:
        return {"stable": False, "validity": [], "warnings": []}
    with np.errstate(over="ignore", invalid="ignore"):
        impacts = [found.impact for found in impacts_of_rows(setup, rows)]
    return {"stable": True, **as_json(setup, extremes.result(impacts))}


def sentences_of(found: Iterable[dict[str, Any]]) -> list[tuple[str, str]]:
    """Heads and sentences on what is out of range, then on what is left out."""
    heads = {"out of range": "OUT OF RANGE:", "left out": "Left out:"}
    said = [(heads[f["state"]], f"{f['sentence']}.") for f in found if f["state"] in heads]
    return sorted(said, key=lambda words: list(heads.values()).index(words[0]))


def show_left_out(console: Console, found: Iterable[dict[str, Any]]) -> None:
    """Print these sentences."""
    for head, sentence in sentences_of(found):
        style = "yellow" if head == "Left out:" else "bold red"
        console.print(styled((head, style), f" {sentence}"), soft_wrap=True)


def table_of(found: Iterable[dict[str, Any]]) -> Table:
    """All indicators with their thresholds."""
    table = Table(title="What the run leaves out")
    for heading in ("effect", "formula", "value", "threshold", ""):
        table.add_column(heading, justify="right" if heading in ("value", "threshold") else "left")
    for finding in found:
        value = finding["value"]
        falls = finding["beyond"] < finding["threshold"]
        style = {"out of range": "bold red", "left out": "yellow"}.get(finding["state"], "")
        table.add_row(
            finding["name"], finding["formula"], "" if math.isnan(value) else f"{value:.2g}",
            f"{'>' if falls else '<'} {finding['threshold']:.2g}",
            styled((finding["state"], style)),
        )  # fmt: skip
    return table
