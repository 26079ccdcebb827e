"""Sentences on a run: what it comes to, which law ran, how it kept pace."""

from hertzloop.analysis.figures import Saturation
from hertzloop.analysis.meters import Stability
from hertzloop.analysis.recorded import IN_TIME, Clock, LawRan, Pacing
from hertzloop.analysis.trust import LawAccuracy, Moved, NotAgain, Obstacle
from hertzloop.analysis.verdict import Change, Control, Outcome, Over, Reasons, Verdict
from hertzloop.controller.loading.registry import shipped
from hertzloop.views.format import known_digits, percent, time_words

# Decibels have one digit: where in a sample the touch falls decides about the second.
UNSTABLE = "UNSTABLE:"  # how the sentence on an unstable loop, the first of a verdict, begins
_LONGEST = 200  # characters that are shown of what a controller says
_OVER = {
    Over.ONLY: "",
    Over.ALL: " over all contacts",
    Over.FIRST: " (first impact; later ones are not predictable)",
    Over.FIRST_KNOWN: " (first impact; whether later ones are predictable is not known)",
}
_CHANGED = {"radiated_j": "radiated energy", "plate_speed_max_m_s": "largest plate speed"}
_MOVED = {
    Moved.PENETRATION: "the penetration",
    Moved.REBOUND_SPEED: "the rebound speed",
    Moved.PLATE_ENERGY: "the plate energy",
}


def verdict_sentences(found: Verdict) -> list[str]:
    """What a run comes to."""
    said, figures = [], found.ran.figures
    stability = figures.stability
    if stability.unstable:
        said.append(_unstable(stability))
    elif stability.pumps:
        said.append(_pumping(stability))
    if not stability.unstable and not figures.impacts:
        said.append("No impact within the run.")
    if found.control:
        said += _control(found.control)
    if figures.impacts and not figures.last_contact_ended:
        said.append(
            "The last contact is not over at the end of the run: its length, its rebound and the "
            "energies have what there is of it; take a longer run.duration_s."
        )
    if found.ran.saturation:
        said.append(_saturation(found.ran.saturation))
    if found.law_accuracy:
        said.append(law_accuracy_sentence(found.law_accuracy))
    return said


def _saturation(found: Saturation) -> str:
    times = "once" if found.times == 1 else f"{found.times} times"
    return (
        f"The samples left the sensor's range {times}, first at {found.since_s * 1e3:.4g} ms: "
        "there the law saw the end of the range, not what happened (sensors.full_scale)."
    )


def _unstable(stability: Stability) -> str:
    """That the loop is unstable, from when on, and how far it went."""
    since = ""
    if stability.since_s is not None:
        since = f" From {stability.since_s * 1e3:.4g} ms on it has put in more than all of it."
    return (
        f"{UNSTABLE} the actuator answers what it causes itself and puts in "
        f"{stability.most_injected:.3g} times the energy of the impact.{since} Its largest "
        f"force, {stability.largest_force_n:.3g} N, is {stability.of_contact:.3g} times what "
        "the impact can cause. A comparison with the run without control would say nothing."
    )


def _pumping(stability: Stability) -> str:
    """That the loop puts in more than there was, though it does not go on doing so."""
    since = ""
    if stability.since_s is not None:
        since = f", from {stability.since_s * 1e3:.4g} ms on"
    return (
        f"The loop pumps: the actuator puts in {stability.fed_in:.2g} times the energy that the "
        f"sphere brought{since}. What moves then is its own doing: no impact could cause it."
    )


def _control(found: Control) -> list[str]:
    """Whether control helped, in what, and why not."""
    if found.outcome is Outcome.IDLE:
        return ["Control did nothing: the law never pushed."]
    if found.outcome is Outcome.UNPREDICTABLE:
        return [
            "Whether control helps is not predictable: the model's error, which the first impact "
            "magnifies, is larger than the change of the plate energy."
        ]
    change, over = known_digits(found.energy_db, "+.1f", found.error_db), _OVER[found.over]
    words = {
        Outcome.HELPS: f"Control helps: plate energy {change} dB{over}",
        Outcome.HARMS: f"Control does harm: plate energy {change} dB{over}",
        Outcome.HARDLY: f"Control hardly changes the plate energy{over}",
    }[found.outcome]
    of = "" if found.once else " (first impact)"
    better = [_change(change, of) for change in found.changes if change.better]
    worse = [_change(change, of) for change in found.changes if not change.better]
    words += "".join(f", {word}" for word in better)
    if worse:
        words += f"; {'but' if better or found.energy_db < 0.0 else 'and'} {', '.join(worse)}"
    return [f"{words}.", *(_reasons(found.reasons) if found.reasons else [])]


def _change(found: Change, of: str) -> str:
    if found.figure in _CHANGED:
        return f"{_CHANGED[found.figure]} {known_digits(found.value, '+.1f', found.error)} dB{of}"
    if found.from_nothing:
        return "the sphere rebounds, where it hardly did"
    return f"the sphere rebounds {known_digits(found.value, '.0f', found.error)} % as high"


def _reasons(found: Reasons) -> list[str]:
    said = []
    if found.after_touch_s is not None and found.late_share is not None:
        said.append(
            f"its first force comes {1e6 * found.after_touch_s:.3g} us after the touch, "
            f"{100.0 * found.late_share:.0f} % of the contact without control"
        )
    if found.apart is not None:
        said.append(f"{100.0 * found.apart:.0f} % of its push falls where nothing touches")
    if found.injected_j is not None:
        said.append(f"it puts {1e6 * found.injected_j:.3g} uJ into the plate")
    if found.dent_m is not None:
        said.append(
            f"the plate keeps a dent of {1e6 * found.dent_m:.2g} um, which a law that answers the "
            "gap takes for penetration"
        )
    return [f"Why not: {'; '.join(said)}."] if said else []


def law_accuracy_sentence(found: LawAccuracy) -> str:
    """Which figure twice the modes move by how much, and why."""
    figure, by_modes = found.most_moved, found.by_modes
    said = (
        "The accuracy asked for is not kept under the law: twice the modes, up to "
        f"{by_modes.frequency_limit_hz / 1e3:.4g} kHz, change {_MOVED[figure]} of the first impact "
        f"by {percent(by_modes.largest)} (asked: {percent(found.asked)})"
    )
    if found.latches_otherwise:
        said += (
            f", as the law then latches {found.finer_delay_us:g} us, not {found.delay_us:g} us: "
            "what it decides here hangs on less than the model's error"
        )
    return f"{said}."


def why_not_words(found: NotAgain | None) -> str:
    """Why a run cannot be simulated again, in words that follow "since"; empty where it can."""
    if found is None:
        return ""
    if found.law is not None:
        law = law_line(found.law)
        return f"the forces are not known to be those of the scene's law: {law}"
    return {
        Obstacle.NOT_ENDED: "the run did not end",
        Obstacle.TOO_LONG: "it takes too long to simulate this run again",
        Obstacle.NOT_HERE: f"the run cannot be simulated here: {found.error}",
    }.get(found.obstacle, found.error)


def law_line(data: LawRan) -> str:
    """Which law the forces of a recording come from."""
    ran, announced = law_words(data.law, data.law_digest), data.scene_law
    if ran and data.law == announced and data.law_digest in (None, data.scene_law_digest):
        return ran
    said = ran or "not said by the controller"
    scene = law_words(announced, data.scene_law_digest)
    return f"{said} (the scene says {scene})" if announced else said


def law_words(name: str | None, digest: str | None) -> str:
    """A law's name, with no more of it than fits, and what its files are."""
    words = "".join(c for c in " ".join((name or "").split()) if c.isprintable())[:_LONGEST]
    own = name is not None and name not in shipped()
    return f"{words}, digest {digest[:_LONGEST]}" if digest and own else words


def pacing_sentences(found: Pacing) -> list[str]:
    """What a person can act on."""
    missed = (
        f"{found.late_forces:,} of {found.steps:,} forces came late "
        f"({100 * found.share_late:.2g} %), at most {found.longest_row:,} in a row"
    )
    if not found.late_forces:
        missed = f"None of {found.steps:,} forces came late"
    clock = found.clock
    if clock is None:
        if found.is_repeat:
            return [f"{missed}, as in the run that this one repeats."]
        return [
            f"{missed} in what was recorded; the response times, which the plant tells at the end "
            "of a run, are not in it."
        ]
    said = [
        f"Pace {clock.pace:g}: {missed}"
        + (f", the worst {time_words(clock.late_max_us)} late" * bool(found.late_forces))
        + f"; the plant itself was at most {time_words(clock.behind_max_us)} behind the clock.",
        "From a sample to its answer: "
        + ", ".join(f"{name} {time_words(us)}" for name, us in clock.response_us.items())
        + f" (of {time_words(clock.slack_us)} that this pace leaves).",
    ]
    return [*said, _pacing_advice(clock)]


def _pacing_advice(found: Clock) -> str:
    controller, plant = found.controller_pace, found.plant_pace or found.controller_pace
    could = min(controller, plant)
    words = f"This machine, as it was, holds a pace of {could:.1g} with {100 * IN_TIME:g} % in time"
    if could >= found.pace:
        return f"{words}: this one leaves room."
    if plant < controller:
        return f"{words}: the plant's own work takes the time; take --pace {could:.1g} or less."
    more_us = float(f"{found.latency_wanted_us:.2g}")
    return (
        f"{words}: take --pace {could:.1g} or less, a controller.latency_us that is {more_us:g} "
        "more, or a machine with nothing else to do (and --realtime on)."
    )
