"""How a paced run kept pace: response times, missed deadlines, what the machine could hold."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console

from hertzloop.commands.terminal import styled
from recordings.reader import Recording

SHARES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p99.9": 0.999}
_MOST_OCTAVES = 64
IN_TIME = 0.999  # of the answers, at a pace that a machine is said to hold


@dataclass(frozen=True)
class Responses:
    """Answers by response time: upper ends of the classes, us, and how many are in each; the
    longest, us."""

    ends_us: np.ndarray
    answers: np.ndarray
    longest_us: float

    def within_us(self, share: float) -> float:
        """Time within which this share of the answers came, to the width of a class."""
        reached = np.cumsum(self.answers) >= share * np.sum(self.answers)
        return float(min(self.ends_us[int(np.argmax(reached))], self.longest_us))

    def in_time(self, slack_us: float) -> float:
        """Share of the answers that came within this time."""
        return float(np.sum(self.answers[self.ends_us <= slack_us]) / np.sum(self.answers))


def class_ends_ns(count: int, an_octave: int) -> np.ndarray:
    """Upper ends of the first classes: as wide as 1 ns up to 2 * an_octave ns, then twice as wide
    from octave to octave."""
    octave, within = np.divmod(np.arange(1, count + 1), an_octave)
    shift = np.maximum(octave - 1, 0)
    return np.where(octave < 1, within, (an_octave + within) * 2.0**shift)


def responses_of(recording: Recording) -> Responses | None:
    """Response times of a paced run; None of another, or where they cannot be read."""
    if recording.pacing is None:
        return None
    header, answers = recording.pacing.header, recording.pacing.arrays["answers"]
    if not 0 < len(answers) <= _MOST_OCTAVES * header.classes_an_octave:
        return None
    if not (np.isfinite(answers).all() and (answers >= 0).all() and answers.sum() > 0):
        return None
    if not (0 < header.pace < math.inf and header.step_ns and header.lead_steps):
        return None
    ends = class_ends_ns(len(answers), header.classes_an_octave)
    return Responses(1e-3 * ends, answers, 1e-3 * header.response_max_ns)


def of(recording: Recording) -> dict[str, Any] | None:
    """Missed deadlines of a recorded run, paced or repeated, and what the clock said of a paced
    one; None of a run in lock-step."""
    if "held_steps" not in recording.truth.arrays:
        return None
    return _missed(recording) | _clock(recording)


def _missed(recording: Recording) -> dict[str, Any]:
    late = oldest = longest = row = 0
    for arrays in recording.truth.blocks():
        held = np.asarray(arrays["held_steps"])
        late, oldest = late + int(np.count_nonzero(held)), max(oldest, int(held.max(initial=0)))
        # Rows of the block end where a force was in time; the last may go on in the next.
        in_time = np.flatnonzero(np.concatenate([held == 0, [True]]))
        rows = np.diff(np.concatenate([[-1 - row], in_time])) - 1
        longest = max(longest, int(rows.max()))
        row = int(rows[-1])
    steps = recording.truth.samples
    return {
        "late_forces": late,
        "steps": steps,
        "share_late": late / steps if steps else 0.0,
        "longest_row": longest,
        "oldest_steps": oldest,
    }


def _clock(recording: Recording) -> dict[str, Any]:
    responses = responses_of(recording)
    if recording.pacing is None or responses is None:
        return {"pace": None, "is_repeat": "repeats" in recording.metadata}
    header = recording.pacing.header
    lead_us = 1e-3 * header.lead_steps * header.step_ns
    held_us = responses.within_us(IN_TIME)
    simulated_ns = recording.truth.samples * header.step_ns
    return {
        "pace": header.pace,
        "slack_us": lead_us / header.pace,
        "answers": int(responses.answers.sum()),
        "response_us": {name: responses.within_us(share) for name, share in SHARES.items()}
        | {"max": responses.longest_us},
        "answers_in_time": responses.in_time(lead_us / header.pace),
        "late_max_us": 1e-3 * header.late_max_ns,
        "behind_max_us": 1e-3 * header.behind_max_ns,
        "controller_pace": lead_us / held_us,
        "plant_pace": simulated_ns / header.working_ns if header.working_ns else None,
        "latency_wanted_us": max(0.0, held_us * header.pace - lead_us),
    }


def time_words(us: float) -> str:
    """A time to two digits."""
    for unit, length in (("s", 1e6), ("ms", 1e3)):
        if us >= length:
            return f"{float(f'{us / length:.2g}'):g} {unit}"
    return f"{float(f'{us:.2g}'):g} us"


def sentences(found: dict[str, Any]) -> list[str]:
    """What a person can act on."""
    missed = (
        f"{found['late_forces']:,} of {found['steps']:,} forces came late "
        f"({100 * found['share_late']:.2g} %), at most {found['longest_row']:,} in a row"
    )
    if not found["late_forces"]:
        missed = f"None of {found['steps']:,} forces came late"
    if found["pace"] is None:
        if found["is_repeat"]:
            return [f"{missed}, as in the run that this one repeats."]
        return [
            f"{missed} in what was recorded; the response times, which the plant tells at the end "
            "of a run, are not in it."
        ]
    held = found["response_us"]
    said = [
        f"Pace {found['pace']:g}: {missed}"
        + (f", the worst {time_words(found['late_max_us'])} late" * bool(found["late_forces"]))
        + f"; the plant itself was at most {time_words(found['behind_max_us'])} behind the clock.",
        "From a sample to its answer: "
        + ", ".join(f"{name} {time_words(us)}" for name, us in held.items())
        + f" (of {time_words(found['slack_us'])} that this pace leaves).",
    ]
    return [*said, _advice(found)]


def _advice(found: dict[str, Any]) -> str:
    controller, plant = found["controller_pace"], found["plant_pace"] or found["controller_pace"]
    could = min(controller, plant)
    words = f"This machine, as it was, holds a pace of {could:.1g} with {100 * IN_TIME:g} % in time"
    if could >= found["pace"]:
        return f"{words}: this one leaves room."
    if plant < controller:
        return f"{words}: the plant's own work takes the time; take --pace {could:.1g} or less."
    more_us = float(f"{found['latency_wanted_us']:.2g}")
    return (
        f"{words}: take --pace {could:.1g} or less, a controller.latency_us that is {more_us:g} "
        "more, or a machine with nothing else to do (and --realtime on)."
    )


def show(console: Console, data: dict[str, Any]) -> None:
    """Print what is to be said of pace and repetition in a report, if anything."""
    for sentence in sentences(data["pacing"]) if data.get("pacing") else ():
        console.print(styled(sentence), soft_wrap=True)
    if "repeats" in data:
        differs = data["differs"]
        said = f"not the run in {data['repeats']}: {differs}" if differs else (
            f"the same bytes as in {data['repeats']}"
        )  # fmt: skip
        console.print(styled((f"Repeated: {said}.", "red" if differs else "bold")), soft_wrap=True)
