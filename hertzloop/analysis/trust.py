"""How far the figures of a run can be trusted.

Three questions: what a finer model changes in the first impact (`verify`), whether a law lets a run
keep its accuracy (`law_accuracy`), and how well later impacts can be known at all
(`predictability`).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, StrEnum, auto

import numpy as np

from hertzloop.analysis.cases import latched_us
from hertzloop.analysis.figures import Figures, Ran
from hertzloop.analysis.impacts import first_impact, impacts_of_blocks
from hertzloop.analysis.meters import control_force_n
from hertzloop.analysis.recorded import LawRan, law_of
from hertzloop.loop.compiled import LawStopped, closed_loop_rows, finer_loop, simulate
from hertzloop.plant import state_kernels as pk
from hertzloop.plant.figures.impacts import Impact, impacts_in
from hertzloop.plant.figures.noise import ImpactNoise
from hertzloop.plant.plant import MOST_MODES, Plant, PlantSpec
from hertzloop.plant.schemes.factory import built
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1, XI
from hertzloop.recordings.recording import Recording
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup, model_error, parse
from hertzloop.setup.build import build_plant

_MOST_WORK = 2e9  # steps times frequencies of a run that is repeated only to judge a recording
_START = [pk.FLIGHT_X, pk.FLIGHT_V, pk.XI, pk.XI_S]
_SMALL = 0.01  # of a push, from which on it stores 1e-4 of what it did


@dataclass(frozen=True)
class Verification:
    """What the finer model changes in the first impact: gap relative to its largest value in
    contact, rebound speed to the impact speed, plate energy to itself; and what it was."""

    penetration: float
    rebound_speed: float
    plate_energy: float
    step_ns: float
    frequency_limit_hz: float
    largest: float = field(init=False)
    """largest of the three relative changes"""

    def __post_init__(self) -> None:
        largest = max(self.penetration, self.rebound_speed, self.plate_energy)
        object.__setattr__(self, "largest", largest)


def verify(setup: Setup, rows: np.ndarray) -> Verification | None:
    """Repeat the first impact of a run, known by its rows of truth, with the loop closed: the law
    answers the finer plant, from samples of the scene's own step.

    None without an impact that ends within the run. Raises SceneError for the published scheme.
    """
    check_verifiable(setup)
    return against(setup, rows, finer_spec(setup))


def check_verifiable(setup: Setup) -> None:
    """Raise SceneError where the finer plant cannot be computed."""
    if not SCHEMES[setup.scheme].converges:
        raise SceneError(
            f"run.scheme = '{setup.scheme}' does not converge and cannot be verified. "
            "Use 'modal' or 'discrete_gradient'."
        )
    fine = finer_spec(setup)
    modes = fine.plate.modes_below(fine.frequency_limit_hz)
    if modes > MOST_MODES:
        local = fine.plate.local_plate
        raise SceneError(
            f"--verify needs about {modes:.2g} modes of the plate up to "
            f"{fine.frequency_limit_hz:.3g} Hz; the limit is {MOST_MODES}. Remove --verify, or "
            f"use a smaller or thicker plate than plate.size_m = "
            f"{list(setup.size_m or ())} with plate.thickness_m = "
            f"{local.thickness_m if local else math.nan:g}"
        )


def finer_spec(setup: Setup) -> PlantSpec:
    """A scene's plant with half the step and twice the modes, as far as they are known."""
    spec = setup.plant
    limit_hz = spec.frequency_limit_hz
    if spec.plate.mode_table is None:  # a file has the modes that it has
        limit_hz = min(2.0 * limit_hz, spec.plate.highest_hz)
    return replace(
        spec,
        step_s=spec.step_s / 2,
        frequency_limit_hz=limit_hz,
        residual_flexibility=SCHEMES[setup.scheme].supports_tail,
        infinite_plate=False,
    )


def against(setup: Setup, rows: np.ndarray, fine: PlantSpec) -> Verification | None:
    """What a finer plant changes in the first impact of a run; None as for `verify`."""
    until = past_first_impact(setup, rows)
    if until is None:
        return None
    times = round(setup.step_s / fine.step_s)
    finer_rows = finer_loop(setup, started_as(setup, fine), until, times)
    return changes(setup, rows[:, :until], finer_rows, fine)


def past_first_impact(setup: Setup, rows: np.ndarray) -> int | None:
    """Steps until the first contact is over and by one more, so that it is seen to end, and until
    the push is, for as long again at most: what a spring for the modes left out stores under a
    force counts once it has come back. None if the contact does not end within the rows."""
    found = first_impact(setup, rows)
    if not found or not found.ended:
        return None
    first, end = found.start, min(found.end + 2, rows.shape[1])
    after = rows[:, end : 2 * end - first]
    pushed = np.abs(control_force_n(setup, rows))
    small = _SMALL * pushed[first:end].max()
    over = np.flatnonzero((pushed[end : 2 * end - first] <= small) | (after[F_C] != 0.0))
    return end + (int(over[0]) if len(over) else after.shape[1])


def started_as(setup: Setup, fine: PlantSpec) -> Plant:
    """A finer plant at the start of a scene's run."""
    plant = built(fine, setup.scheme).at_start(setup.touch_phase)
    coarse = build_plant(setup, setup.plant)
    plant.state.body[_START] = coarse.state.body[_START]
    return plant


def changes(
    setup: Setup, rows: np.ndarray, finer_rows: np.ndarray, fine: PlantSpec
) -> Verification | None:
    """What differs in the first impact between a scene's rows and those of a finer plant over the
    same time; None if that has no impact."""
    times = finer_rows.shape[1] // rows.shape[1]
    coarse_impact = impacts_in(setup.plant, rows)[0]
    # Work counts from row to row: without the last part of a step both end at the same time.
    by_finer = impacts_in(fine, finer_rows[:, : finer_rows.shape[1] + 1 - times])
    if not by_finer:
        return None
    contact = math.ceil((coarse_impact.start_s + coarse_impact.duration_s) / setup.step_s) + 2
    gap, finer = rows[XI, :contact], finer_rows[XI, ::times][:contact]
    energy = by_finer[0].plate_energy_j
    change = by_finer[0].rebound_speed_m_s - coarse_impact.rebound_speed_m_s
    return Verification(
        penetration=float(np.abs(gap - finer).max() / -finer.min()),
        rebound_speed=abs(change) / coarse_impact.impact_speed_m_s,
        plate_energy=abs(coarse_impact.plate_energy_j - energy) / abs(energy),
        step_ns=1e9 * fine.step_s,
        frequency_limit_hz=fine.frequency_limit_hz,
    )


_MOST_STEPS = 2_000_000  # that are simulated in memory


class Moved(StrEnum):
    """Figures of the first impact that a finer model moves, as `Verification` names them."""

    PENETRATION = "penetration"
    REBOUND_SPEED = "rebound_speed"
    PLATE_ENERGY = "plate_energy"


# How many modes a plate needs is estimated from what they do to an impact. A law that waits for a
# threshold may meet it so near to a sample that the modes left out decide at which: what it latches
# then differs by a whole sample, and the impact by far more than the modes themselves would do.
@dataclass(frozen=True)
class LawAccuracy:
    """What twice the modes change in the first impact, the loop closed; `asked` and `expected`
    error of the run, relative; delay that the law latches in the run and with twice the modes, us,
    nan of a law that latches none."""

    by_modes: Verification
    asked: float
    expected: float
    delay_us: float
    finer_delay_us: float
    kept: bool = field(init=False)
    """whether the changes are what the run expects"""

    def __post_init__(self) -> None:
        kept = self.by_modes.largest <= max(self.asked, self.expected)
        object.__setattr__(self, "kept", kept)

    @property
    def most_moved(self) -> Moved:
        """The figure that twice the modes change most."""
        return max(Moved, key=lambda figure: getattr(self.by_modes, figure))

    @property
    def latches_otherwise(self) -> bool:
        """Whether the law latches another delay with twice the modes."""
        return self.delay_us != self.finer_delay_us and self.delay_us + self.finer_delay_us > 0.0


def judged(setup: Setup, until_s: float) -> LawAccuracy | None:
    """Simulate the first impact of a scene, over with the push it causes by `until_s`, with its
    modes and with twice as many, as far as the step carries them.

    None without a law, where the step carries no more modes, where more are not known or take long
    to find (a file, edges that are not simply supported, an infinite plate, the published scheme),
    without an impact that ends by then, and where the law stops.
    """
    steps = min(round(until_s / setup.step_s) + 3, setup.steps)
    converges = SCHEMES[setup.scheme].converges
    if not setup.has_law or not converges or steps > _MOST_STEPS:
        return None
    finer = _twice_the_modes(setup)
    if finer is None:
        return None
    # How long a run lasts may decide about the model of its plate.
    short = setup.with_plate_model(setup.plate_model).with_steps(steps)
    try:
        run = simulate(short)
        until = past_first_impact(short, run.rows)
        if until is None:
            return None
        other = simulate(short.with_steps(until), own_plant=started_as(short, finer))
    except LawStopped:
        return None
    found = changes(short, run.rows[:, :until], other.rows, finer)
    if found is None:
        return None
    return LawAccuracy(
        found, setup.accuracy, model_error.expected_error(short, finer.frequency_limit_hz),
        latched_us(short, run), latched_us(short, other),
    )  # fmt: skip


def stated_error(expected: float | None, found: LawAccuracy | None) -> float | None:
    """The error that a run states: the `expected` one, or what twice the modes change under the law
    where that is more than the run expects."""
    if expected is None or found is None or found.kept:
        return expected
    return max(expected, found.by_modes.largest)


def _twice_the_modes(setup: Setup) -> PlantSpec | None:
    spec = setup.plant
    if spec.infinite_plate or spec.plate.simply_supported is None:
        return None
    # Beyond 1/(2 step) is what the steps of a held force put in, which no sample carries.
    limit_hz = min(finer_spec(setup).frequency_limit_hz, 0.5 / setup.step_s)
    if limit_hz <= spec.frequency_limit_hz:
        return None
    return replace(spec, frequency_limit_hz=limit_hz)


# A bounce on a vibrating plate depends on the plate's phase at the touch, so that later impacts may
# magnify what came before them a hundredfold each. What a disturbance of 1e-9 grows to tells by how
# much the model's own error grows, and what two processors that round differently may differ by.
DISTURBANCE = 1e-9  # of the sphere's speed at the start
# What rounding does is as if the start differed by 2e-16 to 6e-16 (measured between a processor
# with fused multiply-add and one without, three scenes); with a margin of more than ten.
ROUNDING = 1e-14
CHAOTIC = 10.0  # times as large as the disturbance: what came before decides
_QUANTITIES = (
    "start_s", "duration_s", "impact_speed_m_s", "rebound_speed_m_s", "peak_force_n",
    "plate_energy_j",
)  # fmt: skip
_FOLLOWS = ("plate_speed_max_m_s",)  # with waves that samples hardly carry: says little of chaos


@dataclass(frozen=True)
class ImpactErrors:
    """Of one impact: how often the disturbance is found in the quantity that moved most, relative
    to it, and by how much each quantity, and each of its noise figures, may be wrong at the model's
    error, in its unit; infinite where the disturbed run has no such impact."""

    amplification: float
    errors: dict[str, float]
    noise_errors: dict[str, float]

    @property
    def chaotic(self) -> bool:
        """Whether the impact depends on what was before it by far too much."""
        return not self.amplification <= CHAOTIC


def known_impacts(
    setup: Setup,
    impacts: Sequence[Impact],
    model_error: float,
    in_lock_step: bool = True,
    noise: Sequence[ImpactNoise] = (),
) -> list[ImpactErrors] | None:
    """What can be known of the impacts of a run, and of their `noise` figures; None where nothing
    can depend on an impact before, and of the published scheme. `model_error`: relative, of the
    run. A run that was not `in_lock_step` has other impacts than the disturbed one for that reason
    alone: each is known as well as the same one in lock-step."""
    if len(impacts) < 2 or not SCHEMES[setup.scheme].converges:
        return None
    others = _impacts(setup, DISTURBANCE)
    run = [] if in_lock_step else _impacts(setup)[: len(impacts)]
    sounds = map(vars, noise) if noise else [{}] * len(impacts)
    recorded = list(zip(map(vars, impacts), sounds, strict=True))
    found = []
    for i, (impact, sound) in enumerate([*run, *recorded[len(run) :]]):
        other_impact, other_sound = others[i] if i < len(others) else ({}, {})
        moved = _moved(impact, other_impact, (*_QUANTITIES, *_FOLLOWS))
        share = [moved[name] / abs(impact[name]) if impact[name] else 0.0 for name in _QUANTITIES]
        errors, noise_errors = (
            {name: value * model_error / DISTURBANCE for name, value in each.items()}
            for each in (moved, _moved(sound, other_sound, sound))
        )
        found.append(ImpactErrors(float(np.max(share)) / DISTURBANCE, errors, noise_errors))
    return found


def _moved(
    figures: dict[str, float], others: dict[str, float], names: Iterable[str]
) -> dict[str, float]:
    """By how much figures differ; infinite where the others have none."""
    return {name: abs(others.get(name, np.inf) - figures[name]) for name in names}


def _impacts(
    setup: Setup, disturbance: float = 0.0
) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Impacts of a run with their noise figures, fields as in `Impact` and `ImpactNoise`."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = impacts_of_blocks(setup, closed_loop_rows(setup, disturbance))
        return [(vars(one.impact), vars(one.noise)) for one in found]


def errors_of(
    known: Sequence[ImpactErrors] | None, impact: int, of: str = "errors"
) -> dict[str, float]:
    """Errors of the figures of an impact that is chaotic, or of its noise (`noise_errors`); empty
    where all digits count."""
    if known is None or impact >= len(known) or not known[impact].chaotic:
        return {}
    return dict(getattr(known[impact], of))


def horizon_step(setup: Setup, tolerance: float) -> int | None:
    """First step at which two processors may differ by more than `tolerance` of a field's largest
    value, None if they agree to the end. Raises SceneError where the scene cannot be simulated."""
    if not SCHEMES[setup.scheme].converges:
        return None
    allowed = tolerance * DISTURBANCE / ROUNDING
    largest = 0.0 * next(closed_loop_rows(setup))[1][:, 0]
    for _, rows in closed_loop_rows(setup):
        largest = np.maximum(largest, np.abs(rows).max(axis=1))
    largest[[F_C1, F_A1]] = largest[[F_C, F_A]]  # slopes are as exact as their forces
    largest[largest == 0.0] = 1.0
    both = zip(closed_loop_rows(setup), closed_loop_rows(setup, DISTURBANCE), strict=True)
    for (first, rows), (_, disturbed) in both:
        apart = np.max(np.abs(rows - disturbed) / largest[:, None], axis=0)
        beyond = np.flatnonzero(~(apart <= allowed))
        if len(beyond):
            return first + int(beyond[0])
    return None


class Obstacle(Enum):
    """Why a run's closed loop cannot be simulated again."""

    NOT_ENDED = auto()
    OTHER_LAW = auto()
    TOO_LONG = auto()
    NOT_HERE = auto()
    LAW_STOPPED = auto()


@dataclass(frozen=True)
class NotAgain:
    """What is in the way of another simulation of a run: the law that ran, where that is not the
    scene's, or the sentence of an error."""

    obstacle: Obstacle
    law: LawRan | None = None
    error: str = ""


@dataclass(frozen=True)
class Predictability:
    """How well the impacts of a run, and of that without control, can be known: None where nothing
    can depend on an impact before, or nothing is known of it. `model_error`: relative, of the
    run."""

    model_error: float | None
    controlled: list[ImpactErrors] | None
    uncontrolled: list[ImpactErrors] | None
    not_again: NotAgain | None = None
    disturbance: float = DISTURBANCE


def predictability(
    setup: Setup, ran: Ran, free: Figures | None, not_again: NotAgain | None = None
) -> Predictability:
    """How well the impacts of a run can be known; one whose forces were late is judged by the same
    in lock-step. Nothing is said of an unstable loop. `free`: of the run without control."""
    error, without = ran.expected_error, setup.without_control(same_plate=True)

    def known(of: Setup, figures: Figures, in_lock_step: bool = True) -> list[ImpactErrors] | None:
        assert error is not None
        return known_impacts(of, figures.impacts, error, in_lock_step, figures.noise)

    own = other = None
    if not not_again and not ran.figures.stability.unstable:
        try:
            own = known(setup, ran.figures, not ran.late)
        except SceneError as stopped:  # the law, in the disturbed run
            not_again = NotAgain(Obstacle.LAW_STOPPED, error=str(stopped))
    if not setup.has_law:
        other = own
    elif error is not None and free is not None:
        other = known(without, free)
    return Predictability(error, own, other, not_again)


def why_not_again(recording: Recording) -> NotAgain | None:
    """Why the closed loop of a recording cannot be simulated again here; None where it can."""
    if recording.books is None:
        return NotAgain(Obstacle.NOT_ENDED)
    law = law_of(recording)
    if not law.as_announced:
        return NotAgain(Obstacle.OTHER_LAW, law)
    if recording.books.frequencies * recording.truth.samples > _MOST_WORK:
        return NotAgain(Obstacle.TOO_LONG)
    try:
        parse(recording.scene_toml)
    except (SceneError, RecursionError) as error:
        return NotAgain(Obstacle.NOT_HERE, error=str(error))
    return None


def law_accuracy(setup: Setup, figures: Figures) -> LawAccuracy | None:
    """Whether the accuracy asked for is kept under the law of a run."""
    if not figures.impacts or figures.stability.unstable:
        return None
    first = figures.impacts[0]
    return judged(setup, first.start_s + 2.0 * first.duration_s)
