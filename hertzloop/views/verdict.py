"""The verdict on a run as sentences: what control changes, why, and what spoils the metrics."""

from collections.abc import Sequence

from rich.text import Text

from hertzloop.common.readable import quantity
from hertzloop.results import verdict as verdicts
from hertzloop.results.metric_rows import MetricRow, UncertainValue
from hertzloop.results.span_metrics import MUCH_DB
from hertzloop.results.spans import IN_WORDS, OTHER, Span
from hertzloop.results.stability import Stability
from hertzloop.views.digits import change_text, known_digits, uncertain_text, value_texts
from hertzloop.views.effects import OUT_OF_RANGE, out_of_range

UNSTABLE = "UNSTABLE:"  # the first words of a verdict on an unstable loop

_LATER_CONTACTS = {
    verdicts.LaterContacts.UNPREDICTABLE: "Later impacts are not predictable.",
    verdicts.LaterContacts.UNKNOWN: "It is unknown whether later impacts are predictable.",
}


def verdict_sentences(found: verdicts.Assessment) -> list[str]:
    """Render the verdict on a run as short sentences: what is out of range, then what control does.

    Args:
        found: The assessment of the run.

    Returns:
        One sentence for each fact. Each usually fits on a line of 80 columns.
    """
    metrics = found.result.metrics
    sentences, stability = out_of_range(metrics.neglected.checks), metrics.stability
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
        f"Plate energy changes by {own_db:+z.1f} dB {IN_WORDS[span]} and by {other_db:+z.1f} dB "
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
        return [
            "The effect of control is unpredictable: the error of the model exceeds the change."
        ]
    sentences = [_plate_energy(found.outcome, found.energy)] if found.energy else []
    if found.later in _LATER_CONTACTS:
        sentences.append(_LATER_CONTACTS[found.later])
    sentences += _over_all_contacts(found)
    sides = [("Better", found.better), ("Worse", found.worse)]
    for head, rows in sorted(
        sides, key=lambda side: -max((row.size for row in side[1]), default=0)
    ):
        if rows:
            listed = ", ".join(map(_change_words, rows))
            sentences.append(f"{head} (first impact): {listed}.")
    return [*sentences, *(_reasons(found.reasons) if found.reasons else [])]


def _plate_energy(outcome: verdicts.ControlEffect, row: MetricRow) -> str:
    """State how the plate energy of the first impact changes."""
    effect, where = verdicts.ControlEffect, IN_WORDS["impact"]
    change = row.change
    if change is None:
        own, without = value_texts(row)
        return f"Control changes plate energy from {without} to {own} {where}."
    if outcome is effect.HARDLY:
        return f"Control leaves plate energy nearly unchanged {where}."
    if outcome is effect.HELPS_OR_HARMS:
        return f"Control changes plate energy by {change_text(row)} {where}."
    verb = "reduces"
    if outcome in (effect.HARMS, effect.HARMS_OR_HARDLY):
        verb = "increases"
    if outcome in (effect.HELPS_OR_HARDLY, effect.HARMS_OR_HARDLY):
        most = max(abs(change.least), abs(change.most))
        found = known_digits(most, ".1f", change.error)
        return f"Control {verb} plate energy by at most {found} dB {where}."
    least, most = sorted((abs(change.least), abs(change.most)))
    size = UncertainValue(abs(change.value), change.error, least, most)
    return f"Control {verb} plate energy by {uncertain_text(size, '.1f')} dB {where}."


def _over_all_contacts(found: verdicts.Control) -> list[str]:
    """State how the plate energy of all contacts changes, where that differs by much."""
    whole, first = found.whole, found.energy.change if found.energy else None
    if whole is None or first is None or found.contacts is None:
        return []
    if max(abs(whole.least - first.least), abs(whole.most - first.most)) <= MUCH_DB:
        return []
    with_, without = (uncertain_text(count, ".0f") for count in found.contacts)
    return [
        f"Over all contacts the change is {uncertain_text(whole, '+.1f')} dB, with {with_} contact"
        f"{'' if with_ == '1' else 's'} instead of {without}."
    ]


def _change_words(row: MetricRow) -> str:
    """Return the name of a metric and its change, as in the table."""
    if row.from_zero:
        own, without = value_texts(row)
        return f"{row.label} {own} instead of {without}"
    return f"{row.label} {change_text(row)}"


def _reasons(found: verdicts.Reasons) -> list[str]:
    """Return a sentence on each reason why control does not help."""
    reasons = []
    if found.after_touch_s is not None and found.late_share is not None:
        reasons.append(
            f"the first force comes {quantity(found.after_touch_s, 's')} after contact begins "
            f"({100.0 * found.late_share:z.0f} % of it)"
        )
    if found.apart is not None:
        reasons.append(f"{100.0 * found.apart:z.0f} % of the control impulse acts without contact")
    if found.injected_j is not None:
        reasons.append(f"the actuator adds {quantity(found.injected_j, 'J')} to the plate")
    if found.dent_m is not None:
        reasons.append(
            f"the law takes the permanent dent of {1e6 * found.dent_m:.2g} um for penetration"
        )
    return [f"Reason: {reason}." for reason in reasons]


def verdict_lines(verdict: Sequence[str]) -> list[Text]:
    """Return the verdict on a run as lines, the first sentence on its result in bold."""
    lines = [Text(sentence) for sentence in verdict]
    for line in lines[:1]:
        line.stylize("bold")
    for i, sentence in enumerate(verdict[:2]):
        for head in (UNSTABLE, OUT_OF_RANGE):
            if sentence.startswith(head):
                lines[i] = Text.assemble((head, "bold red"), sentence[len(head) :])
    return lines
