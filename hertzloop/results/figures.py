"""Figures of a run, from its recording or from memory: what `run` and `inspect` report."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from bus.messages_pb2 import Books
from hertzloop.results import left_out, pacing
from hertzloop.results.conclusions import conclusions
from hertzloop.results.demand import DemandMeter
from hertzloop.results.extremes import ExtremesMeter
from hertzloop.results.impact_rows import Block, impacts_of_blocks
from hertzloop.results.law import law_of
from hertzloop.results.model_cost import chosen_model
from hertzloop.results.plate_words import tail_of, theory_of
from hertzloop.results.spans import WholeRunMeter, of_impact
from hertzloop.results.stability import StabilityMeter
from hertzloop.results.verdict import PushMeter, saturation_of
from hertzloop.setup import Setup
from plant.balance import Balance
from plant.figures.impacts import Impact
from plant.schemes.registry import SCHEMES
from plant.time_series import TRUTH
from recordings.columns import Arrays
from recordings.reader import Recording

_OF_ROWS = ("impacts", "noise", "first_impact", "whole_run", "last_contact_ended", "stability",
            "demand", "push", "validity", "warnings")  # fmt: skip
NEEDED_FIELDS = set(TRUTH) - {"xi_a_m", "f_c1_n", "f_a1_n", "deepest_m"}


def rows_of(recording: Recording) -> np.ndarray:
    """Rows of truth of a recording, shape (10, steps); the actuator's place is the struck point
    and forces are constant over a step where the recording does not say otherwise.

    All of them at once: for a long recording, see `blocks_of`.
    """
    rows = np.zeros((len(TRUTH), recording.truth.samples))
    at = 0
    for _, block in blocks_of(recording):
        rows[:, at : at + block.shape[1]] = block
        at += block.shape[1]
    return rows[:, :at]


def blocks_of(recording: Recording) -> Iterator[Block]:
    """The same in blocks, each with its first step, up to the first value that is not finite."""
    yield from _rows(recording, _placed(recording.truth.blocks()))


def _placed(blocks: Iterable[Arrays]) -> Iterator[tuple[int, Arrays]]:
    """Blocks with the position of their first row."""
    at = 0
    for arrays in blocks:
        yield at, arrays
        at += len(arrays["xi_m"])


def pieces_of(recording: Recording) -> Iterator[Block]:
    """The same in larger blocks, for what costs by the block."""
    yield from _rows(recording, recording.truth.pieces())


def _rows(recording: Recording, pieces: Iterable[tuple[int, Arrays]]) -> Iterator[Block]:
    truth = recording.truth
    if not set(truth.arrays) >= NEEDED_FIELDS:
        return
    for at, arrays in pieces:
        rows = stacked(arrays)
        finite = np.isfinite(rows).all(axis=0)
        if not finite.all():
            yield int(truth.step_at(at)), rows[:, : int(np.argmin(finite))]
            return
        yield int(truth.step_at(at)), rows


def stacked(columns: Arrays) -> np.ndarray:
    """Rows of truth, shape (10, steps), from columns by their names."""
    constant = np.zeros(len(columns["xi_m"]))
    missing = dict.fromkeys(("f_c1_n", "f_a1_n", "deepest_m"), constant)
    known = missing | {"xi_a_m": columns["xi_p_m"]} | columns
    return np.stack([known[name] for name in TRUTH])


def figures_of(setup: Setup, rows: np.ndarray | Iterable[Block]) -> dict[str, Any]:
    """Impacts, their noise figures, the loop's stability and what it asks of the actuator for
    --json from rows of truth, at once or in blocks.

    Two lists of the same length: `impacts` with keys as in `Impact`, `noise` as in
    `ImpactNoise`, and whether the `last_contact_ended`; `first_impact` and `whole_run` as in
    `SpanFigures`, None without a contact, the latter also of the published scheme; `stability` as
    in `Stability`, `demand` on the actuator as in `Demand` or None, `push` as in `PushMeter`;
    `validity` and `warnings` as in `left_out.as_json`, empty of an unstable loop.
    """
    figures: dict[str, Any] = {
        "impacts": [], "noise": [], "first_impact": None, "whole_run": None,
        "last_contact_ended": True,
    }  # fmt: skip
    blocks = [(0, rows)] if isinstance(rows, np.ndarray) else rows
    spec = setup.plant
    stable, asked = StabilityMeter(setup), DemandMeter(spec)
    extremes, push = ExtremesMeter(spec), PushMeter(setup)
    impacts: list[Impact] = []
    whole = WholeRunMeter(spec) if SCHEMES[setup.scheme].conserves else None
    for meter in (stable, asked, extremes, push):
        blocks = meter.through(blocks)
    blocks = whole.through(blocks) if whole else blocks
    with np.errstate(over="ignore", invalid="ignore"):  # of a loop that explodes
        for found in impacts_of_blocks(setup, blocks):
            if not impacts:
                figures["first_impact"] = asdict(of_impact(found))
            impacts.append(found.impact)
            figures["impacts"].append(asdict(found.impact))
            figures["noise"].append(asdict(found.noise))
            figures["last_contact_ended"] = found.ended
        total = whole.result(impacts) if whole else None
        figures["whole_run"] = asdict(total) if total else None
    demand, stability = asked.result(), stable.result()
    figures["stability"] = asdict(stability)
    figures["demand"] = None if demand is None else asdict(demand)
    figures["push"] = push.result()
    if stability.unstable:
        return figures | {"validity": [], "warnings": []}
    return figures | left_out.as_json(setup, extremes.result(impacts))


def reported(
    setup: Setup, columns: Arrays, books: Books | Balance, known: dict[str, Any]
) -> dict[str, Any]:
    """What a verdict needs of a run whose columns of truth are in memory: its figures, what its
    energy balance says, and what else is `known` of it (law, saturation, pacing)."""
    more = {
        "injected_j": books.injected_j, "yield": yield_of(books),
        "expected_error": setup.expected_error,
    }  # fmt: skip
    return {**figures_of(setup, stacked(columns)), **known, **more}


def yield_of(books: Books | Balance) -> dict[str, float] | None:
    """Dent and energy of a contact that yielded; None of one that did not."""
    if books.dent_m == 0.0:
        return None
    return {"dent_m": books.dent_m, "dissipated_j": books.plastic_dissipated_j}


def radiation_of(setup: Setup, books: Books) -> dict[str, float] | None:
    """Faces of the plate that radiate, and what air took over the run; None where it takes
    nothing."""
    faces = setup.bodies.radiating_faces
    return {"faces": faces, "dissipated_j": books.air_dissipated_j} if faces else None


def struck(setup: Setup) -> dict[str, Any]:
    """What is struck: `name`, `closed_form`, and what its modes are worth; see `Reached` and
    `ModalStructure.mobility_ratio`."""
    what = setup.structure
    if what.quality is None:
        return {"name": "a simply supported plate", "closed_form": True}
    modes = setup.scene.plate.modes
    of_file = {} if what.mode_table is None else {"sha256": modes.sha256 if modes else ""}
    return {"name": str(what), "closed_form": False, **what.quality, **of_file}


def of_recording(
    setup: Setup, recording: Recording, uncontrolled: dict[str, Any] | None, why_not: str = ""
) -> dict[str, Any]:
    """All figures of a recorded run, and what they come to (see `conclusions`).

    Args:
        scene: The scene of the run.
        recording: The run.
        uncontrolled: Figures of the same run without control, None if it is that itself.
        why_not: Why its closed loop cannot be simulated again, where that is so.
    """
    books = recording.books
    report = {
        **law_of(recording),
        "injected_j": books.injected_j if books else 0.0,
        "yield": yield_of(books) if books else None,
        "expected_error": books.expected_error if books else None,
        "requested_accuracy": setup.accuracy,
        **figures_of(setup, blocks_of(recording)),
        "pacing": pacing.of(recording),
    }
    if uncontrolled is not None:
        report["uncontrolled"] = uncontrolled
    return report | conclusions(setup, report, saturation_of(recording.events), why_not)


def run_report(
    setup: Setup,
    recording: Recording,
    uncontrolled: dict[str, Any] | None,
    *,
    transport: str,
    wall_s: float,
    exchanges: int,
    lane: str = "",
    realtime: str = "",
) -> dict[str, Any]:
    """Everything that `run --json` writes; `uncontrolled` are the figures of the same run without
    control, None if it is that itself."""
    books = recording.books
    if books is None:
        raise ValueError("the recording has no books: the run did not end")
    found = of_recording(setup, recording, uncontrolled)
    own = {name: found[name] for name in _OF_ROWS}
    return {
        "scene": setup.name,
        "seed": setup.seed,
        "transport": transport,
        "scheme": setup.scheme,
        "steps": setup.steps,
        "wall_s": wall_s,
        "real_time_factor": setup.duration_s / wall_s if wall_s else math.inf,
        "exchanges": exchanges,
        "lane": lane,
        "realtime": realtime,
        "residuals": {"momentum": books.momentum_residual, "energy": books.energy_residual},
        "tail": tail_of(setup, books),
        "theory": theory_of(setup),
        "limiting_pressure": setup.limiting_pressure,
        "radiation": radiation_of(setup, books),
        "frequencies": books.frequencies,
        "frequency_limit_hz": books.frequency_limit_hz,
        "model": chosen_model(setup),
        "struck": struck(setup),
        "newton_iterations_max": books.newton_iterations_max,
        "recording": str(recording.path),
        "uncontrolled": own,
        **found,
    }
