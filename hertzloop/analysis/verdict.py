"""What a run comes to: whether control helped, in what, why not; what spoils the figures."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum, auto

from hertzloop.analysis.figures import Figures, Ran, Saturation, figures_of
from hertzloop.analysis.meters import DECIBELS, change_db
from hertzloop.analysis.model import Yield, yield_of
from hertzloop.analysis.recorded import LawRan, Pacing, blocks_of, law_of, pacing_of
from hertzloop.analysis.trust import (
    LawAccuracy,
    NotAgain,
    Predictability,
    errors_of,
    law_accuracy,
    predictability,
    stated_error,
)
from hertzloop.bus.messages_pb2 import EventKind
from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.recordings.recording import Event, Recording
from hertzloop.setup import Setup

HARDLY_DB = 0.1
_MUCH = 0.1  # share of the push, or of the contact, that is worth a word
_HARDLY_SHARE = 0.02  # of a rebound's height
_FROM_NOTHING = 1e3  # times as high: what is divided by lies within the model's error
_OTHERS = ("radiated_j", "plate_speed_max_m_s")  # that are compared


class ControlEffect(Enum):
    """What control does to the plate energy."""

    IDLE = auto()  # the law never pushed
    UNPREDICTABLE = auto()
    HELPS = auto()
    HARMS = auto()
    HARDLY = auto()


class Later(Enum):
    """What is known of the contacts after the first impact, of which a change of the plate energy
    is."""

    NONE = auto()
    PREDICTABLE = auto()
    UNPREDICTABLE = auto()
    UNKNOWN = auto()  # whether they are predictable


@dataclass(frozen=True)
class Change:
    """By how much control changes another figure of the first impact, in dB, the rebound height in
    per cent of that without control; its error; `from_nothing`: there was next to none."""

    figure: str
    value: float
    error: float
    better: bool
    from_nothing: bool = False


@dataclass(frozen=True)
class Reasons:
    """Why control does not help, each None where it is no reason: time from touch to first force
    and its share of the contact without control, share of the push while nothing touches, energy
    that the actuator puts in, dent that a law takes for penetration."""

    after_touch_s: float | None = None
    late_share: float | None = None
    apart: float | None = None
    injected_j: float | None = None
    dent_m: float | None = None


@dataclass(frozen=True)
class Control:
    """What control changes in the first impact: the plate energy in dB with its error, and other
    figures; what is known of `later` contacts, and the change of the plate energy over all, None
    where it is not predictable; numbers of contacts with and without control; `reasons` where it
    does not help."""

    outcome: ControlEffect
    energy_db: float = 0.0
    error_db: float = 0.0
    later: Later = Later.NONE
    whole_db: float | None = None
    contacts: tuple[int, int] = (1, 1)
    changes: tuple[Change, ...] = ()
    reasons: Reasons | None = None


@dataclass(frozen=True)
class RunVerdict:
    """What a run comes to. `control`: None where there is nothing to compare with; `law_accuracy`:
    of a law that does not let the run keep its accuracy."""

    ran: Ran
    control: Control | None
    law_accuracy: LawAccuracy | None = None


@dataclass(frozen=True)
class Conclusions:
    """What the figures of a run come to. `stated_error`: model error of the run, relative; None
    where it is not known."""

    stated_error: float | None
    predictability: Predictability
    law_accuracy: LawAccuracy | None
    verdict: RunVerdict


@dataclass(frozen=True)
class Judged:
    """A recorded run with all of its figures, those of the same without control (None if it is that
    itself), and what they come to."""

    law: LawRan
    ran: Ran
    yielded: Yield | None
    requested_accuracy: float
    pacing: Pacing | None
    free: Figures | None
    conclusions: Conclusions


def judge(
    setup: Setup, recording: Recording, free: Figures | None, not_again: NotAgain | None = None
) -> Judged:
    """All figures of a recorded run, and what they come to.

    Args:
        setup: The setup of the run, whose closed loop is simulated again.
        recording: The run.
        free: Figures of the same run without control, None if it is that itself.
        not_again: Why the closed loop cannot be simulated again, where that is so.
    """
    books, law = recording.books, law_of(recording)
    figures, pacing = figures_of(setup, blocks_of(recording)), pacing_of(recording)
    ran = Ran(
        figures,
        law.scene_law,
        books.expected_error if books else None,
        injected_j=books.injected_j if books else 0.0,
        dent_m=books.dent_m if books else 0.0,
        late=pacing is not None,
        saturation=saturation_of(recording.events),
        law_models_yield=setup.law_models_yield,
    )
    found = conclusions(setup, ran, free, not_again)
    return Judged(law, ran, yield_of(books), setup.accuracy, pacing, free, found)


def conclusions(
    setup: Setup, ran: Ran, free: Figures | None, not_again: NotAgain | None = None
) -> Conclusions:
    """What the figures of a run come to; arguments as for `judge`."""
    accuracy = None if ran.late or not_again else law_accuracy(setup, ran.figures)
    ran = replace(ran, expected_error=stated_error(ran.expected_error, accuracy))
    known = predictability(setup, ran, free, not_again)
    found = verdict(ran, free, known, accuracy)
    return Conclusions(ran.expected_error, known, accuracy, found)


def verdict(
    ran: Ran,
    free: Figures | None = None,
    known: Predictability | None = None,
    accuracy: LawAccuracy | None = None,
) -> RunVerdict:
    """What a run comes to; without the figures of the same run without control (`free`) on that
    alone which spoils its own."""
    control, figures = None, ran.figures
    comparable = bool(figures.impacts) and not figures.stability.unstable
    if comparable and free is not None and free.impacts and ran.scene_law != NO_CONTROL:
        control = _control(ran, free, known)
    return RunVerdict(ran, control, accuracy if accuracy and not accuracy.kept else None)


def _control(ran: Ran, free: Figures, known: Predictability | None) -> Control:
    """Whether control helped, in what, and why not."""
    figures = ran.figures
    if figures.push is None:
        return Control(ControlEffect.IDLE)
    contacts = len(figures.impacts), len(free.impacts)
    energy, error, later, whole_db = _plate_energy(figures, free, known)
    if error > HARDLY_DB and not _predictable(energy, error):
        return Control(ControlEffect.UNPREDICTABLE)
    outcome = ControlEffect.HARDLY
    if energy < -HARDLY_DB:
        outcome = ControlEffect.HELPS
    elif energy > HARDLY_DB:
        outcome = ControlEffect.HARMS
    reasons = None
    if outcome is not ControlEffect.HELPS:
        reasons = _reasons(ran, free.impacts[0].duration_s)
    changes = tuple(_changes(figures, free, known))
    return Control(outcome, energy, error, later, whole_db, contacts, changes, reasons)


def _predictable(value: float, error: float) -> bool:
    """Whether any digit of a number is, by its largest absolute error; 0 where all digits are."""
    return error == 0.0 or error < abs(value)


def _plate_energy(
    figures: Figures, free: Figures, known: Predictability | None
) -> tuple[float, float, Later, float | None]:
    """Change of the plate energy in the first impact (dB), its error, what is known of later
    contacts, and the change over all of them where that is predictable to the printed digit."""
    sums, errors, whole = [], [], []
    digits = (known.controlled, known.uncontrolled) if known else (None, None)
    for found, of in zip((figures, free), digits, strict=True):
        sums.append([impact.plate_energy_j for impact in found.impacts])
        run = found.whole_run  # None of the published scheme
        whole.append(run.plate_energy_j if run else sum(sums[-1]))
        errors.append([errors_of(of, i).get("plate_energy_j", 0.0) for i in range(len(sums[-1]))])
    energy, error = change_db(whole[0], whole[1], 10.0, sum(errors[0]), sum(errors[1]))
    if len(sums[0]) == len(sums[1]) == 1:
        return energy, error, Later.NONE, None
    if known and known.not_again:
        later, over_all = Later.UNKNOWN, None
    elif error <= HARDLY_DB:
        later, over_all = Later.PREDICTABLE, energy
    else:
        later, over_all = Later.UNPREDICTABLE, None
    first = change_db(sums[0][0], sums[1][0], 10.0, errors[0][0], errors[1][0])
    return *first, later, over_all


def _changes(figures: Figures, free: Figures, known: Predictability | None) -> Iterable[Change]:
    """Other figures of the first impact that are better or worse."""
    if not figures.noise or not free.noise:
        return
    with_, without = vars(figures.noise[0]), vars(free.noise[0])
    wrong, other = (
        errors_of(of, 0, "noise_errors")
        for of in ((known.controlled, known.uncontrolled) if known else (None, None))
    )
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


def _reasons(ran: Ran, contact_s: float) -> Reasons:
    """What the rows say of the reasons."""
    push = ran.figures.push
    assert push is not None
    late = push.after_touch_s / contact_s
    mistaken = ran.dent_m != 0.0 and not ran.law_models_yield
    return Reasons(
        after_touch_s=push.after_touch_s if late > _MUCH else None,
        late_share=late if late > _MUCH else None,
        apart=push.apart if push.apart > _MUCH else None,
        injected_j=ran.injected_j if ran.injected_j > 0.0 else None,
        dent_m=ran.dent_m if mistaken else None,
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
