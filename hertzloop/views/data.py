"""A run as plain data: what `--json` writes, and what the tables show."""

import ctypes
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, fields
from pathlib import Path
from threading import Thread
from typing import Any

from hertzloop.analysis.figures import Figures, free_figures, no_loop
from hertzloop.analysis.impacts import through_first_contact
from hertzloop.analysis.meters import Comparison, RunFigures, SpanFigures
from hertzloop.analysis.model import PlantParts, parts_of
from hertzloop.analysis.recorded import LawRan, PacedClock, Pacing, blocks_of
from hertzloop.analysis.trust import (
    ImpactErrors,
    LawAccuracy,
    Predictability,
    Verification,
    verify,
)
from hertzloop.analysis.verdict import Judged, judge
from hertzloop.processes import fork_server
from hertzloop.processes.launcher import RunOptions, Transport, record
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import Recording, read
from hertzloop.recordings.writer import RecordingError
from hertzloop.setup import Setup
from hertzloop.views.effects import effects_as_json
from hertzloop.views.sentences import verdict_sentences, why_not_words

_M_ARENA_MAX = -8  # of glibc: the most heaps
_BESIDE = 10  # nice value of what must not delay the loop
_CLOCK = [f.name for f in fields(PacedClock)]
_MISSED = [f.name for f in fields(Pacing)]


def _fields(found: Any) -> dict[str, Any] | None:
    return None if found is None else asdict(found)


def figures_as_json(found: Figures) -> dict[str, Any]:
    """`impacts` and `noise`, a dictionary each; `first_impact`, `whole_run`, `stability`, `demand`
    and `push`; `validity` and `warnings` as in `effects_as_json`."""
    return {
        "impacts": [asdict(one) for one in found.impacts],
        "noise": [asdict(one) for one in found.noise],
        "first_impact": _fields(found.first_impact),
        "whole_run": _fields(found.whole_run),
        "last_contact_ended": found.last_contact_ended,
        "stability": asdict(found.stability),
        "demand": _fields(found.demand),
        "push": _fields(found.push),
        **effects_as_json(found.neglected),
    }


def figures_in(report: Mapping[str, Any]) -> RunFigures:
    """The figures in what `run --json` or `inspect --json` writes."""
    spans = {span: report[span] and SpanFigures(**report[span])
             for span in ("first_impact", "whole_run")}  # fmt: skip
    return RunFigures(**spans)


def law_in(report: Mapping[str, Any]) -> LawRan:
    """The law in it."""
    return LawRan(**{f.name: report[f.name] for f in fields(LawRan)})


def pacing_as_json(found: Pacing | None) -> dict[str, Any] | None:
    """Missed deadlines of a paced or repeated run, and what the clock said of a paced one."""
    if found is None:
        return None
    data = asdict(found)
    clock, is_repeat = data.pop("clock"), data.pop("is_repeat")
    return data | (clock or {"pace": None, "is_repeat": is_repeat})


def pacing_in(report: Mapping[str, Any]) -> Pacing | None:
    """What `pacing_as_json` has written into a report."""
    data = report.get("pacing")
    if not data:
        return None
    clock = None if data["pace"] is None else PacedClock(**{key: data[key] for key in _CLOCK})
    missed = {key: value for key, value in data.items() if key in _MISSED}
    return Pacing(**({"is_repeat": False} | missed), clock=clock)


def predictability_as_json(found: Predictability) -> dict[str, Any]:
    """Fields as in `Predictability`; `why_not` in words."""
    return {
        "disturbance": found.disturbance,
        "model_error": found.model_error,
        "controlled": _known(found.controlled),
        "uncontrolled": _known(found.uncontrolled),
        "why_not": why_not_words(found.not_again),
    }


def _known(found: list[ImpactErrors] | None) -> list[dict[str, Any]] | None:
    return None if found is None else [asdict(each) for each in found]


def known_in(found: list[dict[str, Any]] | None) -> list[ImpactErrors] | None:
    """What is known of the impacts of a run, from what `predictability_as_json` writes."""
    return None if found is None else [ImpactErrors(**each) for each in found]


def verification_as_json(found: Verification | None) -> dict[str, float] | None:
    """Fields as in `Verification`, and the largest change."""
    return None if found is None else {**asdict(found), "largest": found.largest}


def _law_accuracy(found: LawAccuracy | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {**asdict(found), "largest": found.by_modes.largest, "kept": found.kept}


def comparison_as_json(found: Comparison) -> list[dict[str, Any]]:
    """A dictionary for each figure, with fields as in `Difference`."""
    return [asdict(row) for row in found.rows]


def judged_as_json(found: Judged) -> dict[str, Any]:
    """All figures of a recorded run, and what they come to."""
    ran, ends = found.ran, found.conclusions
    data = {
        **asdict(found.law),
        "injected_j": ran.injected_j,
        "yield": _fields(found.yielded),
        "expected_error": ran.expected_error,
        "requested_accuracy": found.requested_accuracy,
        **figures_as_json(ran.figures),
        "pacing": pacing_as_json(found.pacing),
    }
    if found.free is not None:
        data["uncontrolled"] = figures_as_json(found.free)
    return data | {
        "predictability": predictability_as_json(ends.predictability),
        "law_accuracy": _law_accuracy(ends.law_accuracy),
        "verdict": verdict_sentences(ends.verdict),
    }


def struck(setup: Setup) -> dict[str, Any]:
    """The structure: `name`, `closed_form`, and what its modes are worth; see `Reached` and
    `ModalStructure.mobility_ratio`."""
    what = setup.structure
    if what.quality is None:
        plain = what.simply_supported is not None
        return {"name": "a simply supported plate" if plain else str(what), "closed_form": True}
    modes = setup.scene.plate.modes
    of_file = {} if what.mode_table is None else {"sha256": modes.sha256 if modes else ""}
    return {"name": str(what), "closed_form": False, **what.quality, **of_file}


def _parts(found: PlantParts) -> dict[str, Any]:
    data = asdict(found)
    if found.theory is not None:
        error = found.theory.kirchhoff_error
        data["theory"]["kirchhoff_error"] = error._asdict() | {"largest": error.largest}
    return data


def run_as_json(
    setup: Setup,
    recording: Recording,
    judged: Judged,
    *,
    transport: str,
    wall_s: float,
    exchanges: int,
    lane: str = "",
    realtime: str = "",
) -> dict[str, Any]:
    """Everything that `run --json` writes."""
    books = recording.books
    if books is None:
        raise ValueError("the recording has no energy balance: the run did not end")
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
        **_parts(parts_of(setup, books)),
        "frequencies": books.frequencies,
        "frequency_limit_hz": books.frequency_limit_hz,
        "struck": struck(setup),
        "newton_iterations_max": books.newton_iterations_max,
        "recording": str(recording.path),
        "uncontrolled": figures_as_json(judged.free or judged.ran.figures),
        **judged_as_json(judged),
    }


@contextmanager
def _compared_beside(
    setup: Setup, options: RunOptions, on_progress: Callable[[int], None]
) -> Iterator[Callable[[int], None]]:
    """Simulate the run without control while the processes of the run start, and from the end of
    their loop on; the figures are kept. Yields what is to be told of the progress.

    Not in a run that follows the wall clock, nor where the loop runs in this process: a thread
    that calls Python would delay each of its blocks. What else a run is compared with is simulated
    after it, since it would take a core from the loop.
    """
    if options.transport is not Transport.ZENOH or options.pace:
        yield on_progress
        return
    setup.check()
    fork_server.prepare()  # before there is a thread
    with suppress(AttributeError):  # of another C library than glibc
        # A heap of the thread's own would keep its largest size, beside that of this thread.
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)

    def simulate() -> None:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, _BESIDE)  # of this thread
        with suppress(Exception):  # raised again where the figures are needed
            free_figures(setup)

    def hear(step: int) -> None:
        if step < setup.steps:
            no_loop.clear()
        else:
            no_loop.set()
        on_progress(step)

    beside = Thread(target=simulate, daemon=True)
    beside.start()
    try:
        yield hear
    finally:
        no_loop.set()
    beside.join()


def run_scene(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    on_progress: Callable[[int], None] = lambda step: None,
) -> dict[str, Any]:
    """Run and record a scene; the report that `run --json` writes. Raises as `record`."""
    with _compared_beside(setup, options, on_progress) as hear:
        stats = record(setup, recording, options, hear)
    recorded = read(recording)
    if recorded.metadata.get("run_id") != stats["run_id"]:
        raise RecordingError(
            f"{recording} holds run {recorded.metadata.get('run_id')}, not {stats['run_id']} that "
            "was started here: another run has replaced it"
        )
    if recorded.problems:
        raise RecordingError(f"{recording}: {recorded.problems[0]}")
    verified = None
    if options.verify:
        rows = through_first_contact(blocks_of(recorded))
        verified = verify(setup, rows)
    report = run_as_json(
        setup,
        recorded,
        judge(setup, recorded, free_figures(setup)),
        transport=options.transport.value,
        wall_s=stats["wall_s"],
        exchanges=int(stats["exchanges"]),
        lane=stats["lane"],
        realtime=stats.get("realtime", ""),
    )
    if options.repeat:
        report["repeats"] = str(options.repeat)
        report["differs"] = first_difference(read(options.repeat), recorded)
    if options.verify:
        report["verification"] = verification_as_json(verified)
    return report
