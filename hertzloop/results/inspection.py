"""The contents of a recording, with its metrics where these follow from it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.bus.messages_pb2 import EventKind
from hertzloop.recordings.recording import Event, Recording, SampledStream
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.metric_rows import Rows, metric_rows
from hertzloop.results.metrics import Metrics, RunResult, Saturation, free_metrics, metrics_of
from hertzloop.results.predictability import Predictability, predictability
from hertzloop.results.recorded import (
    MOST_WORK,
    NEEDED_FIELDS,
    Pacing,
    RecordedLaw,
    law_of,
    missing_from,
    pacing_of,
    setup_of,
    truth_of,
    why_not_repeatable,
)
from hertzloop.results.touch_phases import at_other_phases
from hertzloop.scene.setup import Setup


@dataclass(frozen=True)
class Assessment:
    """A run beside the same run without control.

    Attributes:
        result: the run.
        free: metrics without control; None without a comparison.
        predictability: how well the impacts can be known.
        rows: all metrics, with their errors, ranges and changes.
    """

    result: RunResult
    free: Metrics | None
    predictability: Predictability
    rows: Rows


def assess(setup: Setup, result: RunResult, free: Metrics | None, why_not: str = "") -> Assessment:
    """Compare the metrics of a run with those without control, and estimate their errors.

    Args:
        setup: The setup of the run, whose closed loop is simulated again.
        result: The run.
        free: Metrics of the same run without control, None without a comparison.
        why_not: Why the closed loop cannot be simulated again, where that is so.
    """
    known = predictability(setup, result, free, why_not)
    phases = at_other_phases(setup, result, known)
    return Assessment(result, free, known, metric_rows(result, free, known, phases))


@dataclass(frozen=True)
class Inspected:
    """A recording, its problems, and its metrics.

    Attributes:
        recording: The recording.
        problems: A sentence on each missing or damaged part.
        law: Law that the forces come from.
        pacing: Missed deadlines of a paced or repeated run; None in lock-step.
        assessment: The metrics, beside those without control if these are wanted; None if the
            recording has no metrics.
    """

    recording: Recording
    problems: Sequence[str]
    law: RecordedLaw
    pacing: Pacing | None
    assessment: Assessment | None = None

    @property
    def seed(self) -> int:
        """Random seed of the run; 0 if it is not recorded."""
        return self.number("seed")

    def number(self, key: str) -> int:
        """Return a number from the description of the run; 0 if there is none."""
        try:
            return int(self.recording.metadata.get(key, "0"))
        except ValueError:
            return 0


def inspected(
    recording: Recording,
    against_none: bool = False,
    setup: Setup | None = None,
    most_work: float = MOST_WORK,
) -> Inspected:
    """Return the contents of a recording, with its metrics.

    Args:
        recording: The recording.
        against_none: Whether the run is compared with the same without control.
        setup: The setup of the run, if it is known.
        most_work: Steps times frequencies of a run that is simulated again.

    A file may hold any numbers. If no metrics follow from them, that is one more problem of the
    recording, not an error of the program.
    """
    law, pacing = law_of(recording), pacing_of(recording)
    bare = Inspected(recording, recording.problems, law, pacing)
    try:
        setup = setup or setup_of(recording)
        problem = _contradiction(recording.truth, setup)
        if not problem:
            with np.errstate(all="ignore"):
                metrics = metrics_of(setup, truth_of(recording), missing_from(recording, setup))
                result = recorded_result(setup, recording, metrics, law, pacing)
                free = free_metrics(setup) if against_none else None
                found = assess(setup, result, free, why_not_repeatable(recording, most_work))
            return replace(bare, assessment=found)
    except RecordingError as error:
        problem = str(error)
    except (ArithmeticError, ValueError) as error:
        problem = f"no metrics follow from what was recorded: {error}"
    return replace(bare, problems=[*recording.problems, problem])


def recorded_result(
    setup: Setup, recording: Recording, metrics: Metrics, law: RecordedLaw, pacing: Pacing | None
) -> RunResult:
    """Return the result of a recorded run, whose metrics, law and missed deadlines are known."""
    balance = recording.balance
    return RunResult(
        metrics,
        law.scene_law,
        balance.expected_error if balance else None,
        injected_j=balance.injected_j if balance else 0.0,
        dent_m=balance.dent_m if balance else 0.0,
        late=pacing is not None,
        saturation=saturation_of(recording.events),
        complete=missing_from(recording, setup) is None,
    )


def saturation_of(events: Iterable[Event]) -> Saturation | None:
    """How often, and since when, samples were out of the converter's range where it matters, by a
    recording's events: a gap during a contact, anything else at any time. None if never."""
    since_ns: list[int] = []
    touching = out = counted = of_gap = False
    for event in events:
        if event.name != "plant":
            continue
        kind = event.data.kind
        if kind in (EventKind.CONTACT_BEGAN, EventKind.CONTACT_ENDED):
            touching = kind == EventKind.CONTACT_BEGAN
        elif kind in (EventKind.RANGE_LEFT, EventKind.RANGE_REGAINED):
            out, counted = kind == EventKind.RANGE_LEFT, False
            of_gap = event.data.quantity == "xi"
        matters = touching or not of_gap
        if out and matters and not counted:
            since_ns.append(event.time_ns)
            counted = True
    return Saturation(len(since_ns), since_ns[0] * 1e-9) if since_ns else None


def _contradiction(truth: SampledStream, setup: Setup) -> str:
    """Say what of the time series contradicts the scene; empty if nothing does."""
    if truth.samples and setup.run.step_ns != truth.step_ns:
        steps = f"{truth.step_ns} ns, those of its scene {setup.run.step_ns} ns"
        return f"stream 'truth' has steps of {steps}"
    lacking = NEEDED_FIELDS - set(truth.arrays)
    if truth.samples and lacking:
        return f"stream 'truth' has no {', '.join(sorted(lacking))}"
    return ""
