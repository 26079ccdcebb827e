"""Assess a run: whether control helped, in what, why not, and what spoils the metrics."""

from dataclasses import dataclass
from enum import Enum, auto

from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.metric_rows import MetricRow, Rows, UncertainValue, metric_rows, row_of
from hertzloop.results.metrics import Metrics, RunResult
from hertzloop.results.predictability import (
    NOTHING_KNOWN,
    Predictability,
    errors_of,
    later_impacts_known,
    predictability,
)
from hertzloop.results.span_metrics import change_db
from hertzloop.results.touch_phases import SAME_PHASE, OtherPhases, at_other_phases
from hertzloop.scene.setup import Setup

HARDLY_DB = 0.1
_LEAST = {"dB": 0.05, "%": 0.5}  # change that is more than zero as printed
_MUCH = 0.1  # share of the push, or of the contact, that is worth a word


class ControlEffect(Enum):
    """What control does to the plate energy of the first impact, at every touch phase."""

    IDLE = auto()  # no force of the law acts
    UNPREDICTABLE = auto()
    HELPS = auto()
    HARMS = auto()
    HARDLY = auto()
    HELPS_OR_HARDLY = auto()
    HARMS_OR_HARDLY = auto()
    HELPS_OR_HARMS = auto()


class LaterContacts(Enum):
    """What is known of the contacts after the first impact."""

    NONE = auto()
    PREDICTABLE = auto()
    UNPREDICTABLE = auto()
    UNKNOWN = auto()  # whether they are predictable


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
        energy: the plate energy of the first impact, and its change; None without a force.
        later: what is known of later contacts.
        whole: change of the plate energy over all contacts, dB; None if not predictable.
        contacts: numbers of contacts with and without control; None if not predictable.
        better: other metrics of the first impact that control improves, the largest change first.
        worse: other metrics that it makes worse.
        reasons: why control does not help; None if it helps.
    """

    outcome: ControlEffect
    energy: MetricRow | None = None
    later: LaterContacts = LaterContacts.NONE
    whole: UncertainValue | None = None
    contacts: tuple[UncertainValue, UncertainValue] | None = None
    better: Rows = ()
    worse: Rows = ()
    reasons: Reasons | None = None


@dataclass(frozen=True)
class Assessment:
    """The assessment of a run's metrics.

    Attributes:
        result: the run.
        control: what control changes; None if there is no run to compare with.
        predictability: how well the impacts can be known.
        rows: all metrics, with their errors, ranges and changes.
    """

    result: RunResult
    control: Control | None
    predictability: Predictability
    rows: Rows


def assess(
    setup: Setup,
    result: RunResult,
    free: Metrics | None,
    why_not: str = "",
) -> Assessment:
    """Assess the metrics of a run.

    Args:
        setup: The setup of the run, whose closed loop is simulated again.
        result: The run.
        free: Metrics of the same run without control, None without a comparison.
        why_not: Why the closed loop cannot be simulated again, where that is so.
    """
    known = predictability(setup, result, free, why_not)
    return verdict(result, free, known, at_other_phases(setup, result, known))


def verdict(
    result: RunResult,
    free: Metrics | None = None,
    known: Predictability = NOTHING_KNOWN,
    phases: OtherPhases = SAME_PHASE,
) -> Assessment:
    """Return the assessment of a run whose errors are known; without `free`, the metrics of the run
    without control, it says only what spoils the metrics."""
    control, metrics = None, result.metrics
    rows = metric_rows(result, free, known, phases)
    comparable = bool(metrics.impacts) and not metrics.stability.unstable
    if comparable and free is not None and free.impacts and result.scene_law != NO_CONTROL:
        control = _control(result, free, known, rows)
    return Assessment(result, control, known, rows)


def _control(result: RunResult, free: Metrics, known: Predictability, rows: Rows) -> Control:
    """Evaluate whether control helped, in what, and why not."""
    metrics = result.metrics
    if metrics.push is None:
        return Control(ControlEffect.IDLE)
    energy = row_of(rows, "first_impact", "plate_energy_j")
    assert energy is not None
    if energy.change is None and not energy.value.known:
        return Control(ControlEffect.UNPREDICTABLE)
    if energy.change and energy.change.error > HARDLY_DB and not energy.change.known:
        return Control(ControlEffect.UNPREDICTABLE)
    later, whole, contacts = _later_contacts(result, free, known), None, None
    if later is LaterContacts.PREDICTABLE:
        over_all = row_of(rows, "whole_run", "plate_energy_j")
        counted = row_of(rows, "whole_run", "contacts")
        whole = over_all.change if over_all else None
        if counted and counted.reference:
            contacts = counted.value, counted.reference
    outcome = _effect(energy)
    reasons = None
    if outcome not in (ControlEffect.HELPS, ControlEffect.HELPS_OR_HARDLY):
        reasons = _reasons(result, free.impacts[0].duration_s)
    better, worse = _other_changes(rows)
    return Control(outcome, energy, later, whole, contacts, better, worse, reasons)


def _effect(energy: MetricRow) -> ControlEffect:
    """What the change of the plate energy means, from its least to its largest value."""
    if energy.change is None:  # no ratio: control takes more out of the plate than the impact gives
        assert energy.reference is not None
        less = energy.value.value < energy.reference.value
        return ControlEffect.HELPS if less else ControlEffect.HARMS
    change = energy.change
    helps, harms = change.least < -HARDLY_DB, change.most > HARDLY_DB
    if helps and harms:
        return ControlEffect.HELPS_OR_HARMS
    if helps:
        always = change.most < -HARDLY_DB
        return ControlEffect.HELPS if always else ControlEffect.HELPS_OR_HARDLY
    if harms:
        always = change.least > HARDLY_DB
        return ControlEffect.HARMS if always else ControlEffect.HARMS_OR_HARDLY
    return ControlEffect.HARDLY


def _later_contacts(result: RunResult, free: Metrics, known: Predictability) -> LaterContacts:
    """What is known of later contacts: predictable are those whose energies are known so well that
    the printed digit of the change over all contacts is."""
    ours, theirs = result.metrics, free
    if result.complete and len(ours.impacts) == len(theirs.impacts) == 1:
        return LaterContacts.NONE
    if known.why_not or not result.complete:
        return LaterContacts.UNKNOWN
    wrong = 0.0
    for metrics, errors in ((ours, known.controlled), (theirs, known.uncontrolled)):
        if not later_impacts_known(metrics.by_impact, errors):
            return LaterContacts.UNPREDICTABLE
        each = [impact.plate_energy_j for impact in metrics.impacts]
        lost = sum(errors_of(errors, i).get("plate_energy_j", 0.0) for i in range(len(each)))
        wrong += change_db(sum(each), sum(each), 10.0, lost)[1]
    return LaterContacts.PREDICTABLE if wrong <= HARDLY_DB else LaterContacts.UNPREDICTABLE


def _other_changes(rows: Rows) -> tuple[Rows, Rows]:
    """Return the other metrics of the first impact that are better, and those that are worse at
    every touch phase, the largest change first."""
    better, worse = [], []
    for row in sorted(rows, key=lambda row: -row.size):
        of_impact = row.span == "first_impact" and row.metric != "plate_energy_j"
        if not (of_impact and row.field.less_is_better and row.size > HARDLY_DB):
            continue
        if row.from_zero:
            worse.append(row)
        elif row.change:
            least = max(row.change.error, _LEAST[row.unit])
            if row.change.most < -least:
                better.append(row)
            elif row.change.least > least:
                worse.append(row)
    return better, worse


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
