"""Sentences on a run: what it comes to, which law ran, how it kept pace."""

from hertzloop.analysis.cases import IN_WORDS, OTHER, Span
from hertzloop.analysis.effects import percent, time_words
from hertzloop.analysis.figures import Saturation
from hertzloop.analysis.meters import MUCH_DB, Stability
from hertzloop.analysis.recorded import IN_TIME, LawRan, PacedClock, Pacing
from hertzloop.analysis.trust import LawAccuracy, Moved, NotAgain, Obstacle
from hertzloop.analysis.verdict import Change, Control, ControlEffect, Later, Reasons, RunVerdict
from hertzloop.controller.loading.registry import shipped
from hertzloop.views.format import known_digits

# Decibels have one digit: the second depends on where in a sample the contact begins.
UNSTABLE = "UNSTABLE:"  # the first words of a verdict on an unstable loop
_LONGEST = 200  # characters that are shown of a controller's own words
_LATER = {
    Later.NONE: "",
    Later.PREDICTABLE: " in the first impact",
    Later.UNPREDICTABLE: " (first impact; later ones are not predictable)",
    Later.UNKNOWN: " (first impact; it is unknown whether later ones are predictable)",
}
_CHANGED = {"radiated_j": "radiated energy", "plate_speed_max_m_s": "largest plate speed"}
_MOVED = {
    Moved.PENETRATION: "penetration",
    Moved.REBOUND_SPEED: "rebound speed",
    Moved.PLATE_ENERGY: "plate energy",
}


def verdict_sentences(found: RunVerdict) -> list[str]:
    """Render the verdict on a run as short sentences, the outcome of control first.

    Args:
        found: The typed verdict of `hertzloop.analysis.verdict`.

    Returns:
        One sentence for each fact. Each usually fits on a line of 80 columns.
    """
    said, figures = [], found.ran.figures
    stability = figures.stability
    if stability.unstable:
        said += _unstable(stability)
    if not stability.unstable and not figures.impacts:
        said.append("No impact occurs within the run.")
    if found.control:
        said += _control(found.control)
    if stability.pumps and not stability.unstable:
        said.append(_pumping(stability))
    if figures.impacts and not figures.last_contact_ended:
        said.append("The run ends during the last contact. Increase run.duration_s.")
    if found.ran.saturation:
        said.append(_saturation(found.ran.saturation))
    if found.law_accuracy:
        said += law_accuracy_sentences(found.law_accuracy)
    return said


def spans_differ(own_db: float, other_db: float | None, span: Span, hint: str) -> list[str]:
    """State the change of the plate energy in both spans where it differs by much.

    Args:
        own_db: The change in `span`, dB.
        other_db: The change in the other span, dB; None without one.
        span: The span that the command evaluates.
        hint: What to do, a sentence.

    Returns:
        One sentence and the hint, or nothing.
    """
    if other_db is None or not abs(other_db - own_db) > MUCH_DB:
        return []
    return [
        f"Plate energy changes by {own_db:+.1f} dB {IN_WORDS[span]} and by {other_db:+.1f} dB "
        f"{IN_WORDS[OTHER[span]]}, because the contacts after the first differ. {hint}".strip()
    ]


def _saturation(found: Saturation) -> str:
    times = "once" if found.times == 1 else f"{found.times} times"
    return (
        f"The sensor saturated {times}, first at {found.since_s * 1e3:.4g} ms (sensors.full_scale)."
    )


def _unstable(stability: Stability) -> list[str]:
    """State that the loop is unstable, from when, and how far it diverged."""
    said = [
        f"{UNSTABLE} the actuator supplies {stability.most_injected:.3g} times the impact energy."
    ]
    if stability.since_s is not None:
        said.append(
            f"From {stability.since_s * 1e3:.4g} ms on, it supplies more than the impact energy."
        )
    return [
        *said,
        f"Largest actuator force: {stability.largest_force_n:.3g} N, "
        f"{stability.of_contact:.3g} times the limit of the impact.",
        "An unstable run is not compared with the run without control.",
    ]


def _pumping(stability: Stability) -> str:
    """State that the loop adds energy, although it does not diverge."""
    since = ""
    if stability.since_s is not None:
        since = f" from {stability.since_s * 1e3:.4g} ms on"
    return f"The loop adds energy{since}: {stability.fed_in:.2g} times the energy of the sphere."


def _control(found: Control) -> list[str]:
    """State what control changes, and why it does not help where that is so."""
    if found.outcome is ControlEffect.IDLE:
        return ["Control has no effect: the law never commands a force."]
    if found.outcome is ControlEffect.UNPREDICTABLE:
        return ["The effect of control is unpredictable: the model error exceeds the change."]
    change = known_digits(abs(found.energy_db), ".1f", found.error_db)
    over = _LATER[found.later]
    said = [
        {
            ControlEffect.HELPS: f"Control reduces plate energy by {change} dB{over}.",
            ControlEffect.HARMS: f"Control increases plate energy by {change} dB{over}.",
            ControlEffect.HARDLY: f"Control leaves plate energy nearly unchanged{over}.",
        }[found.outcome]
    ]
    if found.whole_db is not None and abs(found.whole_db - found.energy_db) > MUCH_DB:
        with_, without = found.contacts
        said.append(
            f"Over all contacts the change is {found.whole_db:+.1f} dB, with {with_} contact"
            f"{'s' if with_ > 1 else ''} instead of {without}."
        )
    for better, head in ((True, "Better"), (False, "Worse")):
        listed = [_change(one) for one in found.changes if one.better is better]
        of = "" if found.later is Later.NONE else " (first impact)"
        if listed:
            said.append(f"{head}{of}: {', '.join(listed)}.")
    return [*said, *(_reasons(found.reasons) if found.reasons else [])]


def _change(found: Change) -> str:
    if found.figure in _CHANGED:
        return f"{_CHANGED[found.figure]} {known_digits(found.value, '+.1f', found.error)} dB"
    if found.from_nothing:
        return "rebound height, from nearly zero"
    return (
        f"rebound height {known_digits(found.value, '.0f', found.error)} % of that without control"
    )


def _reasons(found: Reasons) -> list[str]:
    """Render each reason why control does not help, one sentence each."""
    said = []
    if found.after_touch_s is not None and found.late_share is not None:
        said.append(
            f"the first force comes {1e6 * found.after_touch_s:.3g} us after contact begins "
            f"({100.0 * found.late_share:z.0f} % of it)"
        )
    if found.apart is not None:
        said.append(f"{100.0 * found.apart:z.0f} % of the control impulse acts without contact")
    if found.injected_j is not None:
        said.append(f"the actuator adds {1e6 * found.injected_j:.3g} uJ to the plate")
    if found.dent_m is not None:
        said.append(
            f"the law takes the permanent dent of {1e6 * found.dent_m:.2g} um for penetration"
        )
    return [f"Reason: {one}." for one in said]


def law_accuracy_sentences(found: LawAccuracy) -> list[str]:
    """State which figure twice the modes change, by how much, and why.

    Args:
        found: Accuracy of a run under its law.

    Returns:
        One or two sentences.
    """
    figure, by_modes = found.most_moved, found.by_modes
    said = [
        f"Accuracy missed: twice the modes change {_MOVED[figure]} "
        f"by {percent(by_modes.largest)} (requested {percent(found.asked)})."
    ]
    if found.latches_otherwise:
        said.append(
            f"With twice the modes the law latches {found.finer_delay_us:g} us instead of "
            f"{found.delay_us:g} us."
        )
    return said


def why_not_words(found: NotAgain | None) -> str:
    """Why a run cannot be simulated again, in words that follow "since"; empty where it can."""
    if found is None:
        return ""
    if found.law is not None:
        law = law_line(found.law)
        return f"the forces may not come from the law of the scene: {law}"
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
    said = ran or "not reported by the controller"
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


def _pacing_advice(found: PacedClock) -> str:
    controller, plant = found.controller_pace, found.plant_pace or found.controller_pace
    could = min(controller, plant)
    words = f"This machine, as it was, holds a pace of {could:.1g} with {100 * IN_TIME:g} % in time"
    if could >= found.pace:
        return f"{words}: this pace is below the limit."
    if plant < controller:
        return f"{words}: the plant limits the pace. Use --pace {could:.1g} or less."
    more_us = float(f"{found.latency_wanted_us:.2g}")
    return (
        f"{words}: use --pace {could:.1g} or less, increase controller.latency_us by {more_us:g}, "
        "or use an idle computer (and --realtime on)."
    )
