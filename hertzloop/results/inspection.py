"""The contents of a recording, with its metrics where these follow from it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.recordings.recording import Recording, SampledStream
from hertzloop.results.metrics import free_metrics, metrics_of
from hertzloop.results.model import Yield, yield_of
from hertzloop.results.recorded import (
    NEEDED_FIELDS,
    Pacing,
    RecordedLaw,
    law_of,
    missing_from,
    pacing_of,
    truth_of,
)
from hertzloop.results.recorded_result import recorded_result
from hertzloop.results.repeatability import why_not_repeatable
from hertzloop.results.verdict import Assessment, assess
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse


@dataclass(frozen=True)
class Inspected:
    """A recording, its problems, and its metrics.

    Attributes:
        recording: The recording.
        problems: A sentence on each missing or damaged part.
        law: Law that the forces come from.
        pacing: Missed deadlines of a paced or repeated run.
        yielded: Permanent indentation, if the contact yielded.
        assessment: The metrics and how many of their digits are predictable; None if the recording
            has no metrics.
    """

    recording: Recording
    problems: Sequence[str]
    law: RecordedLaw
    pacing: Pacing | None
    yielded: Yield | None
    assessment: Assessment | None

    @property
    def seed(self) -> int:
        """Random seed of the run; 0 if it is not recorded."""
        return number_of(self.recording, "seed")


def inspected(recording: Recording, against_none: bool = False) -> Inspected:
    """Return the contents of a recording, with its metrics.

    Args:
        recording: The recording.
        against_none: Whether the run is compared with the same without control.

    A file may hold any numbers. If no metrics follow from them, that is one more problem of the
    recording, not an error of the program.
    """
    law, pacing, yielded = law_of(recording), pacing_of(recording), yield_of(recording.balance)
    bare = Inspected(recording, recording.problems, law, pacing, yielded, None)
    try:
        setup = parse(recording.scene_toml, recorded=True)
        problem = _contradiction(recording.truth, setup)
        if not problem:
            with np.errstate(all="ignore"):
                metrics = metrics_of(setup, truth_of(recording), missing_from(recording, setup))
                result = recorded_result(setup, recording, metrics, law, pacing)
                free = free_metrics(setup) if against_none else None
                found = assess(setup, result, free, why_not_repeatable(recording))
            return replace(bare, assessment=found)
    except (SceneError, RecursionError) as error:
        problem = f"the scene inside cannot be read: {error}{recording.other_version}"
    except (ArithmeticError, ValueError) as error:
        problem = f"no metrics follow from what was recorded: {error}"
    return replace(bare, problems=[*recording.problems, problem])


def _contradiction(truth: SampledStream, setup: Setup) -> str:
    """Say what of the time series contradicts the scene; empty if nothing does."""
    if truth.samples and setup.run.step_ns != truth.step_ns:
        steps = f"{truth.step_ns} ns, those of its scene {setup.run.step_ns} ns"
        return f"stream 'truth' has steps of {steps}"
    lacking = NEEDED_FIELDS - set(truth.arrays)
    if truth.samples and lacking:
        return f"stream 'truth' has no {', '.join(sorted(lacking))}"
    return ""


def number_of(recording: Recording, key: str) -> int:
    """Return a number from the description of the run; 0 if there is none."""
    try:
        return int(recording.metadata.get(key, "0"))
    except ValueError:
        return 0
