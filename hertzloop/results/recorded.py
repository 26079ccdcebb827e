"""What a recording holds: time series, the law of the controller, and the pacing."""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.bus.streams import CONTROLLER
from hertzloop.plant.time_series import TRUTH, XI_A, XI_P
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse

NEEDED_FIELDS = set(TRUTH) - {"xi_a_m", "f_c1_n", "f_a1_n", "deepest_m"}


def truth_of(recording: Recording) -> np.ndarray:
    """Return the time series of a recording, shape (10, steps).

    The actuator's place is the contact point, and forces are constant over a step, where the
    recording does not say otherwise.
    """
    stream = recording.truth
    if not stream.arrays.keys() >= NEEDED_FIELDS:
        return np.zeros((len(TRUTH), 0))
    truth = stream.matrix(tuple(TRUTH))
    if "xi_a_m" not in stream.arrays:
        truth[XI_A] = truth[XI_P]
    return truth


def setup_of(recording: Recording, to_run: bool = False) -> Setup:
    """Return the setup of a recorded run; `to_run`: with its law, which may not be there any more.

    Raises:
        RecordingError: The scene cannot be read or simulated by this version.
    """
    try:
        return parse(recording.scene_toml, recorded=not to_run)
    except (SceneError, RecursionError) as error:
        words = f"the scene of {recording.path} cannot be simulated here: {error}"
        raise RecordingError(words + recording.other_version) from error


def missing_from(recording: Recording, setup: Setup) -> int | None:
    """Return the first missing step of a run, where its metrics end; None if it has all steps."""
    known = recording.truth.samples
    return known if known < setup.run.steps else None


@dataclass(frozen=True)
class RecordedLaw:
    """The law of a recorded run.

    Attributes:
        law: the law that the controller reported; None if it reported none.
        law_digest: digest of that law's files.
        scene_law: the law that the plant announced; None if it is not known.
        scene_law_digest: digest of the announced law's files.
    """

    law: str | None
    law_digest: str | None
    scene_law: str | None
    scene_law_digest: str | None

    @property
    def as_announced(self) -> bool:
        """Whether the controller reported the announced law, with the same files."""
        same = (self.law, self.law_digest) == (self.scene_law, self.scene_law_digest)
        return bool(self.law) and same


def reported_law(recording: Recording) -> tuple[str, str]:
    """Return name and digest of the law that the controller reported; empty if it reported none."""
    end = recording.ends.get(CONTROLLER)
    return (end.report.law, end.report.law_digest) if end else ("", "")


def law_of(recording: Recording) -> RecordedLaw:
    """Return the law that the forces of a recording come from."""
    ran, digest = reported_law(recording)
    announced = recording.metadata.get("law") or _law_of_scene(recording)
    return RecordedLaw(
        ran or None, digest or None, announced, recording.metadata.get("law_digest") or None
    )


def _law_of_scene(recording: Recording) -> str | None:
    """Of recordings that do not say more."""
    try:
        return setup_of(recording).scene.controller.law
    except RecordingError:
        return None


MOST_WORK = 2e9  # steps times frequencies of a run that is repeated only to judge a recording


def why_not_repeatable(recording: Recording, most_work: float = MOST_WORK) -> str:
    """Return why the closed loop of a recording cannot be simulated again here, in a clause; empty
    if it can."""
    if recording.balance is None:
        return "the run did not end"
    if not law_of(recording).as_announced:
        return "the forces may not come from the law of the scene"
    if recording.balance.frequencies * recording.truth.samples > most_work:
        return "it takes too long to simulate this run again"
    try:
        setup_of(recording, to_run=True)
    except RecordingError as error:
        return str(error)
    return ""


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
    if not (0 < header.pace < math.inf and header.step_ns and header.loop_delay_steps):
        return None
    ends = class_ends_ns(len(answers), header.classes_an_octave)
    return Responses(1e-3 * ends, answers, 1e-3 * header.response_max_ns)


@dataclass(frozen=True)
class PacedClock:
    """What the clock said of a paced run; times in us of wall time, paces as simulated over wall
    time. `*_pace`: what the machine, as it was, could hold."""

    pace: float
    slack_us: float
    answers: int
    response_us: dict[str, float]
    answers_in_time: float
    late_max_us: float
    behind_max_us: float
    controller_pace: float
    plant_pace: float | None
    latency_wanted_us: float


@dataclass(frozen=True)
class Pacing:
    """Missed deadlines of a run, paced or repeated; `clock`: None of a repeated run, and where the
    response times are not known."""

    late_forces: int
    steps: int
    share_late: float
    longest_sequence: int
    oldest_steps: int
    is_repeat: bool
    clock: PacedClock | None


def pacing_of(recording: Recording) -> Pacing | None:
    """Missed deadlines of a recorded run; None of a run in lock-step."""
    if "held_steps" not in recording.truth.arrays:
        return None
    held = np.asarray(recording.truth.arrays["held_steps"])
    late, oldest = int(np.count_nonzero(held)), int(held.max(initial=0))
    in_time = np.flatnonzero(np.concatenate([[True], held == 0, [True]]))
    longest = int((np.diff(in_time) - 1).max())
    steps, repeats = recording.truth.samples, "repeats" in recording.metadata
    share = late / steps if steps else 0.0
    return Pacing(late, steps, share, longest, oldest, repeats, _clock(recording))


def _clock(recording: Recording) -> PacedClock | None:
    responses = responses_of(recording)
    if recording.pacing is None or responses is None:
        return None
    header = recording.pacing.header
    lead_us = 1e-3 * header.loop_delay_steps * header.step_ns
    held_us = responses.within_us(IN_TIME)
    simulated_ns = recording.truth.samples * header.step_ns
    return PacedClock(
        pace=header.pace,
        slack_us=lead_us / header.pace,
        answers=int(responses.answers.sum()),
        response_us={name: responses.within_us(share) for name, share in SHARES.items()}
        | {"max": responses.longest_us},
        answers_in_time=responses.in_time(lead_us / header.pace),
        late_max_us=1e-3 * header.late_max_ns,
        behind_max_us=1e-3 * header.behind_max_ns,
        controller_pace=lead_us / held_us,
        plant_pace=simulated_ns / header.working_ns if header.working_ns else None,
        latency_wanted_us=max(0.0, held_us * header.pace - lead_us),
    )
