"""The verdict on a run as sentences: what control changes, why, and what spoils the metrics."""

from collections.abc import Sequence

from rich.text import Text

from hertzloop.results import verdict as verdicts
from hertzloop.results.law_accuracy import LawAccuracy, SensitiveMetric
from hertzloop.results.rounding import percent
from hertzloop.results.span_metrics import MUCH_DB
from hertzloop.results.spans import IN_WORDS, OTHER, Span
from hertzloop.results.stability import Stability
from hertzloop.views.digits import known_digits

UNSTABLE = "UNSTABLE:"  # the first words of a verdict on an unstable loop

_LATER_CONTACTS = {
    verdicts.LaterContacts.NONE: "",
    verdicts.LaterContacts.PREDICTABLE: " in the first impact",
    verdicts.LaterContacts.UNPREDICTABLE: " (first impact; later ones are not predictable)",
    verdicts.LaterContacts.UNKNOWN: (
        " (first impact; it is unknown whether later ones are predictable)"
    ),
}

_OTHER_METRICS = {"radiated_j": "radiated energy", "plate_speed_max_m_s": "largest plate speed"}

_SENSITIVE_METRICS = {
    SensitiveMetric.PENETRATION: "penetration",
    SensitiveMetric.REBOUND_SPEED: "rebound speed",
    SensitiveMetric.PLATE_ENERGY: "plate energy",
}


def verdict_sentences(found: verdicts.Assessment) -> list[str]:
    """Render the verdict on a run as short sentences, the outcome of control first.

    Args:
        found: The assessment of the run.

    Returns:
        One sentence for each fact. Each usually fits on a line of 80 columns.
    """
    sentences, metrics = [], found.result.metrics
    stability = metrics.stability
    if stability.unstable:
        sentences += _unstable(stability)
    if not stability.unstable and not metrics.impacts:
        sentences.append(
            "No impact occurs within the run."
            if found.result.complete
            else "No impact is known: steps of the run are missing."
        )
    if found.control:
        sentences += _control(found.control)
    if stability.pumps and not stability.unstable:
        sentences.append(_pumping(stability))
    if metrics.impacts and not metrics.last_contact_ended:
        sentences.append("The run ends during the last contact. Increase run.duration_s.")
    if saturation := found.result.saturation:
        times = "once" if saturation.times == 1 else f"{saturation.times} times"
        first = f"first at {saturation.since_s * 1e3:.4g} ms (sensors.full_scale)"
        sentences.append(f"The sensor saturated {times}, {first}.")
    if found.law_accuracy and not found.law_accuracy.kept:
        sentences += law_accuracy_sentences(found.law_accuracy)
    return sentences


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


def _unstable(stability: Stability) -> list[str]:
    """State that the loop is unstable, from when, and how far it diverged."""
    sentences = [
        f"{UNSTABLE} the actuator supplies {stability.most_injected:.3g} times the impact energy."
    ]
    if stability.since_s is not None:
        sentences.append(
            f"From {stability.since_s * 1e3:.4g} ms on, it supplies more than the impact energy."
        )
    return [
        *sentences,
        f"Largest actuator force: {stability.largest_force_n:.3g} N, "
        f"{stability.of_contact:.3g} times the limit of the impact.",
        "An unstable run is not compared with the run without control.",
    ]


def _pumping(stability: Stability) -> str:
    """State that the loop adds energy, although it does not diverge."""
    since = ""
    if stability.since_s is not None:
        since = f" from {stability.since_s * 1e3:.4g} ms on"
    return f"The loop adds energy{since}: {stability.fed_in:.2g} times the energy of the impact."


def _control(found: verdicts.Control) -> list[str]:
    """State what control changes, and why it does not help where that is so."""
    if found.outcome is verdicts.ControlEffect.IDLE:
        return ["Control has no effect: no force of the law acts."]
    if found.outcome is verdicts.ControlEffect.UNPREDICTABLE:
        return ["The effect of control is unpredictable: the model error exceeds the change."]
    # One digit: the second depends on where in a sample the contact begins.
    change = known_digits(abs(found.energy_db), ".1f", found.error_db)
    over = _LATER_CONTACTS[found.later]
    sentences = [
        {
            verdicts.ControlEffect.HELPS: f"Control reduces plate energy by {change} dB{over}.",
            verdicts.ControlEffect.HARMS: f"Control increases plate energy by {change} dB{over}.",
            verdicts.ControlEffect.HARDLY: f"Control leaves plate energy nearly unchanged{over}.",
        }[found.outcome]
    ]
    if found.whole_db is not None and abs(found.whole_db - found.energy_db) > MUCH_DB:
        with_, without = found.contacts
        sentences.append(
            f"Over all contacts the change is {found.whole_db:+.1f} dB, with {with_} contact"
            f"{'s' if with_ > 1 else ''} instead of {without}."
        )
    for better, head in ((True, "Better"), (False, "Worse")):
        listed = [_change_sentence(one) for one in found.changes if one.better is better]
        of = "" if found.later is verdicts.LaterContacts.NONE else " (first impact)"
        if listed:
            sentences.append(f"{head}{of}: {', '.join(listed)}.")
    return [*sentences, *(_reasons(found.reasons) if found.reasons else [])]


def _change_sentence(found: verdicts.Change) -> str:
    """Return the name of a metric and its change."""
    if found.metric in _OTHER_METRICS:
        return f"{_OTHER_METRICS[found.metric]} {known_digits(found.value, '+.1f', found.error)} dB"
    if found.from_nothing:
        return "rebound height, from nearly zero"
    return (
        f"rebound height {known_digits(found.value, '.0f', found.error)} % of that without control"
    )


def _reasons(found: verdicts.Reasons) -> list[str]:
    """Return a sentence on each reason why control does not help."""
    reasons = []
    if found.after_touch_s is not None and found.late_share is not None:
        reasons.append(
            f"the first force comes {1e6 * found.after_touch_s:.3g} us after contact begins "
            f"({100.0 * found.late_share:z.0f} % of it)"
        )
    if found.apart is not None:
        reasons.append(f"{100.0 * found.apart:z.0f} % of the control impulse acts without contact")
    if found.injected_j is not None:
        reasons.append(f"the actuator adds {1e6 * found.injected_j:.3g} uJ to the plate")
    if found.dent_m is not None:
        reasons.append(
            f"the law takes the permanent dent of {1e6 * found.dent_m:.2g} um for penetration"
        )
    return [f"Reason: {reason}." for reason in reasons]


def law_accuracy_sentences(found: LawAccuracy) -> list[str]:
    """State which metric twice the modes change, by how much, and why.

    Args:
        found: Accuracy of a run under its law.

    Returns:
        One or two sentences.
    """
    metric, by_modes = found.most_moved, found.by_modes
    sentences = [
        f"Accuracy missed: twice the modes change {_SENSITIVE_METRICS[metric]} "
        f"by {percent(by_modes.largest)} (requested {percent(found.asked)})."
    ]
    if found.latches_otherwise:
        sentences.append(
            f"With twice the modes the law latches {found.finer_delay_us:g} us instead of "
            f"{found.delay_us:g} us."
        )
    return sentences


def verdict_lines(verdict: Sequence[str], unstable: bool) -> list[Text]:
    """Return the verdict on a run as lines, the first sentence in bold."""
    lines = [Text(sentence, "" if i else "bold") for i, sentence in enumerate(verdict)]
    if lines and unstable:
        lines[0] = Text.assemble((UNSTABLE, "bold red"), verdict[0][len(UNSTABLE) :])
    return lines
