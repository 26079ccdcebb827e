"""Assess a run: whether control helped, in what, why not, and what spoils the metrics."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import NamedTuple

from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.recordings.recording import Recording
from hertzloop.results.law_accuracy import LawAccuracy, law_accuracy, stated_error
from hertzloop.results.metrics import Metrics, RunResult, metrics_of
from hertzloop.results.model import Yield, yield_of
from hertzloop.results.predictability import (
    NOTHING_KNOWN,
    ImpactErrors,
    Predictability,
    errors_of,
    predictability,
)
from hertzloop.results.recorded import (
    Pacing,
    RecordedLaw,
    blocks_of,
    law_of,
    missing_from,
    pacing_of,
)
from hertzloop.results.recorded_result import recorded_result
from hertzloop.results.repeatability import NotRepeatable
from hertzloop.results.span_metrics import DECIBELS, change_db
from hertzloop.scene.setup import Setup

HARDLY_DB = 0.1
_MUCH = 0.1  # share of the push, or of the contact, that is worth a word
_HARDLY_SHARE = 0.02  # of a rebound's height
_FROM_NOTHING = 1e3  # times as high: what is divided by lies within the model's error
_OTHERS = ("radiated_j", "plate_speed_max_m_s")  # that are compared


class ControlEffect(Enum):
    """What control does to the plate energy."""

    IDLE = auto()  # no force of the law acts
    UNPREDICTABLE = auto()
    HELPS = auto()
    HARMS = auto()
    HARDLY = auto()


class LaterContacts(Enum):
    """What is known of the contacts after the first impact."""

    NONE = auto()
    PREDICTABLE = auto()
    UNPREDICTABLE = auto()
    UNKNOWN = auto()  # whether they are predictable


@dataclass(frozen=True)
class Change:
    """Change of another metric of the first impact by control.

    Attributes:
        metric: name of the metric.
        value: change in dB; for the rebound height, per cent of that without control.
        error: error of the change, in the same unit.
        better: whether control improves the metric.
        from_nothing: whether the metric without control is nearly zero.
    """

    metric: str
    value: float
    error: float
    better: bool
    from_nothing: bool = False


@dataclass(frozen=True)
class Reasons:
    """Why control does not help; None for what is not a reason.

    Attributes:
        after_touch_s: time from the first contact to the first force, s.
        late_share: that time over the contact time without control.
        apart: share of the absolute impulse that acts without contact.
        injected_j: work of the actuator on the plate, J.
        dent_m: permanent indentation that the law mistakes for penetration, m.
    """

    after_touch_s: float | None = None
    late_share: float | None = None
    apart: float | None = None
    injected_j: float | None = None
    dent_m: float | None = None


@dataclass(frozen=True)
class Control:
    """What control changes.

    Attributes:
        outcome: the effect on the plate energy.
        energy_db: change of the plate energy in the first impact, dB.
        error_db: error of that change, dB.
        later: what is known of later contacts.
        whole_db: change of the plate energy over all contacts, dB; None if not predictable.
        contacts: numbers of contacts with and without control.
        changes: changes of other metrics.
        reasons: why control does not help; None if it helps.
    """

    outcome: ControlEffect
    energy_db: float = 0.0
    error_db: float = 0.0
    later: LaterContacts = LaterContacts.NONE
    whole_db: float | None = None
    contacts: tuple[int, int] = (1, 1)
    changes: tuple[Change, ...] = ()
    reasons: Reasons | None = None


@dataclass(frozen=True)
class Assessment:
    """The assessment of a run's metrics.

    Attributes:
        result: the run, with the model error that it states.
        control: what control changes; None if there is no run to compare with.
        predictability: how well the impacts can be known.
        law_accuracy: accuracy under the law; None if it was not evaluated.
    """

    result: RunResult
    control: Control | None
    predictability: Predictability
    law_accuracy: LawAccuracy | None


@dataclass(frozen=True)
class RunAssessment:
    """A recorded run with its metrics and their assessment.

    Attributes:
        law: the law that the controller used.
        yielded: the permanent indentation; None if the contact did not yield.
        requested_accuracy: requested model error, relative.
        pacing: missed deadlines; None for a run in lock-step.
        free: metrics of the same run without control; None if the run has no control.
        assessment: what the metrics show.
    """

    law: RecordedLaw
    yielded: Yield | None
    requested_accuracy: float
    pacing: Pacing | None
    free: Metrics | None
    assessment: Assessment

    @property
    def result(self) -> RunResult:
        """The run, with the model error that it states."""
        return self.assessment.result


def assess_recording(
    setup: Setup,
    recording: Recording,
    free: Metrics | None,
    not_repeatable: NotRepeatable | None = None,
) -> RunAssessment:
    """Compute all metrics of a recorded run, and assess them.

    Args:
        setup: The setup of the run, whose closed loop is simulated again.
        recording: The run.
        free: Metrics of the same run without control, None if it is that itself.
        not_repeatable: Why the closed loop cannot be simulated again, where that is so.
    """
    law = law_of(recording)
    metrics = metrics_of(setup, blocks_of(recording), missing_from(recording, setup))
    pacing = pacing_of(recording)
    result = recorded_result(setup, recording, metrics, law, pacing)
    found = assess(setup, result, free, not_repeatable)
    return RunAssessment(law, yield_of(recording.balance), setup.accuracy, pacing, free, found)


def assess(
    setup: Setup,
    result: RunResult,
    free: Metrics | None,
    not_repeatable: NotRepeatable | None = None,
) -> Assessment:
    """Assess the metrics of a run; arguments as for `assess_recording`."""
    accuracy = None if result.late or not_repeatable else law_accuracy(setup, result.metrics)
    result = replace(result, expected_error=stated_error(result.expected_error, accuracy))
    known = predictability(setup, result, free, not_repeatable)
    return verdict(result, free, known, accuracy)


def verdict(
    result: RunResult,
    free: Metrics | None = None,
    known: Predictability = NOTHING_KNOWN,
    accuracy: LawAccuracy | None = None,
) -> Assessment:
    """Return the assessment of a run whose errors are known; without `free`, the metrics of the run
    without control, it says only what spoils the metrics."""
    control, metrics = None, result.metrics
    comparable = bool(metrics.impacts) and not metrics.stability.unstable
    if comparable and free is not None and free.impacts and result.scene_law != NO_CONTROL:
        control = _control(result, free, known)
    return Assessment(result, control, known, accuracy)


def _control(result: RunResult, free: Metrics, known: Predictability) -> Control:
    """Evaluate whether control helped, in what, and why not."""
    metrics = result.metrics
    if metrics.push is None:
        return Control(ControlEffect.IDLE)
    contacts = len(metrics.impacts), len(free.impacts)
    energy, error, later, whole_db = _plate_energy(result, free, known)
    if error > HARDLY_DB and not _predictable(energy, error):
        return Control(ControlEffect.UNPREDICTABLE)
    outcome = ControlEffect.HARDLY
    if energy < -HARDLY_DB:
        outcome = ControlEffect.HELPS
    elif energy > HARDLY_DB:
        outcome = ControlEffect.HARMS
    reasons = None
    if outcome is not ControlEffect.HELPS:
        reasons = _reasons(result, free.impacts[0].duration_s)
    changes = tuple(_changes(metrics, free, known))
    return Control(outcome, energy, error, later, whole_db, contacts, changes, reasons)


def _predictable(value: float, error: float) -> bool:
    """Return whether any digit of a number is predictable, given its largest absolute error."""
    return error == 0.0 or error < abs(value)


def _plate_energy(
    result: RunResult, free: Metrics, known: Predictability
) -> tuple[float, float, LaterContacts, float | None]:
    """Change of the plate energy in the first impact (dB), its error, what is known of later
    contacts, and the change over all of them where that is predictable to the printed digit."""
    ours, theirs = _energies(result.metrics, known.controlled), _energies(free, known.uncontrolled)
    energy, error = change_db(ours.whole, theirs.whole, 10.0, sum(ours.errors), sum(theirs.errors))
    if result.complete and len(ours.each) == len(theirs.each) == 1:
        return energy, error, LaterContacts.NONE, None
    if known.not_repeatable or not result.complete:
        later, over_all = LaterContacts.UNKNOWN, None
    elif error <= HARDLY_DB:
        later, over_all = LaterContacts.PREDICTABLE, energy
    else:
        later, over_all = LaterContacts.UNPREDICTABLE, None
    first = change_db(ours.each[0], theirs.each[0], 10.0, ours.errors[0], theirs.errors[0])
    return *first, later, over_all


class _Energies(NamedTuple):
    """Energy that a plate takes in each impact and in the whole run, J; errors of the former."""

    each: list[float]
    errors: list[float]
    whole: float


def _energies(metrics: Metrics, known: list[ImpactErrors] | None) -> _Energies:
    each = [impact.plate_energy_j for impact in metrics.impacts]
    errors = [errors_of(known, i).get("plate_energy_j", 0.0) for i in range(len(each))]
    run = metrics.whole_run  # None of the published scheme
    return _Energies(each, errors, run.plate_energy_j if run else sum(each))


def _changes(metrics: Metrics, free: Metrics, known: Predictability) -> Iterable[Change]:
    """Yield other metrics of the first impact that are better or worse."""
    if not metrics.noise or not free.noise:
        return
    with_, without = vars(metrics.noise[0]), vars(free.noise[0])
    wrong = errors_of(known.controlled, 0, "noise_errors")
    other = errors_of(known.uncontrolled, 0, "noise_errors")
    for key in _OTHERS:
        change, error = change_db(
            with_[key], without[key], DECIBELS[key], wrong.get(key, 0.0), other.get(key, 0.0)
        )
        if abs(change) > HARDLY_DB and _predictable(change, error):
            yield Change(key, change, error, change < 0.0)
    key = "rebound_height_m"
    height, before = with_[key], without[key]
    if before > 0.0 and abs(height / before - 1.0) > _HARDLY_SHARE:
        error = (wrong.get(key, 0.0) + other.get(key, 0.0) * height / before) / before
        share, error = 100.0 * height / before, 100.0 * error
        if _predictable(share, error):
            from_nothing = height > _FROM_NOTHING * before
            yield Change(key, share, error, height < before, from_nothing)


def _reasons(result: RunResult, contact_s: float) -> Reasons:
    """Return the reasons that the metrics show."""
    push = result.metrics.push
    assert push is not None
    late = push.after_touch_s / contact_s
    return Reasons(
        after_touch_s=push.after_touch_s if late > _MUCH else None,
        late_share=late if late > _MUCH else None,
        apart=push.apart if push.apart > _MUCH else None,
        injected_j=result.injected_j if result.injected_j > 0.0 else None,
        dent_m=result.dent_m or None,
    )
