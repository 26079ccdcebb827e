"""The verdict on a run as sentences: what control changes, why, and what spoils the metrics."""

import math
from collections.abc import Sequence

from rich.text import Text

from hertzloop.common.readable import quantity
from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.inspection import Assessment
from hertzloop.results.metric_rows import MetricRow, Rows, UncertainValue, row_of
from hertzloop.results.metrics import Metrics, RunResult
from hertzloop.results.predictability import errors_of, later_impacts_known
from hertzloop.results.span_metrics import MUCH_DB
from hertzloop.results.spans import IN_WORDS, OTHER, Span
from hertzloop.results.statistics import Stability
from hertzloop.views.digits import change_text, known_digits, uncertain_text, value_texts
from hertzloop.views.effects import OUT_OF_RANGE, out_of_range

UNSTABLE = "UNSTABLE:"  # the first words of a verdict on an unstable loop

_UNPREDICTABLE = "Later impacts are not predictable."
_HARDLY_DB = 0.1
_LEAST = {"dB": 0.05, "%": 0.5}  # change that is more than zero as printed
_MUCH = 0.1  # share of the push, or of the contact, that is worth a word


def verdict_sentences(found: Assessment) -> list[str]:
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
    sentences += _control(found)
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


def _control(found: Assessment) -> list[str]:
    """State what control changes, and why it does not help where that is so."""
    result, free = found.result, found.free
    metrics = result.metrics
    if not metrics.impacts or metrics.stability.unstable or result.scene_law == NO_CONTROL:
        return []
    if free is None or not free.impacts:
        return []
    if metrics.push is None:
        return ["Control has no effect: no force of the law acts."]
    energy = row_of(found.rows, "first_impact", "plate_energy_j")
    assert energy is not None
    change = energy.change
    known = energy.value.known
    if change is not None:
        known = change.known or change.error <= _HARDLY_DB
    if not known:
        return [
            "The effect of control is unpredictable: the error of the model exceeds the change."
        ]
    helps, sentence = _plate_energy(energy)
    sentences = [sentence, *_later_contacts(found, free, change)]
    for head, rows in sorted(
        zip(("Better", "Worse"), _other_changes(found.rows), strict=True),
        key=lambda side: -max((row.size for row in side[1]), default=0),
    ):
        if rows:
            listed = ", ".join(map(_change_words, rows))
            sentences.append(f"{head} (first impact): {listed}.")
    return [*sentences, *([] if helps else _reasons(result, free.impacts[0].duration_s))]


def _plate_energy(row: MetricRow) -> tuple[bool, str]:
    """Return whether control reduces the plate energy of the first impact at any touch phase and
    increases it at none, and state the change."""
    where, change = IN_WORDS["impact"], row.change
    if change is None:  # no ratio: control takes more out of the plate than the impact gives
        assert row.reference is not None
        own, without = value_texts(row)
        sentence = f"Control changes plate energy from {without} to {own} {where}."
        return row.value.value < row.reference.value, sentence
    falls, rises = change.least < -_HARDLY_DB, change.most > _HARDLY_DB
    if falls and rises:
        return False, f"Control changes plate energy by {change_text(row)} {where}."
    if not falls and not rises:
        return False, f"Control leaves plate energy nearly unchanged {where}."
    least, most = sorted((abs(change.least), abs(change.most)))
    if least > _HARDLY_DB and change.least * change.most > 0.0:
        size = UncertainValue(abs(change.value), change.error, least, most)
        words = uncertain_text(size, ".1f")
    else:
        words = f"at most {known_digits(most, '.1f', change.error)}"
    verb = "reduces" if falls else "increases"
    return falls, f"Control {verb} plate energy by {words} dB {where}."


def _later_contacts(found: Assessment, free: Metrics, first: UncertainValue | None) -> list[str]:
    """State whether later contacts are predictable, or how the plate energy of all contacts changes
    where that differs by much from the `first` impact.

    They are predictable if their energies are known so well that the printed digit of the change
    over all contacts is.
    """
    result, known = found.result, found.predictability
    if result.complete and len(result.metrics.impacts) == len(free.impacts) == 1:
        return []
    if known.why_not or not result.complete:
        return ["It is unknown whether later impacts are predictable."]
    wrong = 0.0
    for metrics, errors in ((result.metrics, known.controlled), (free, known.uncontrolled)):
        if not later_impacts_known(metrics.by_impact, errors):
            return [_UNPREDICTABLE]
        energy_j = sum(impact.plate_energy_j for impact in metrics.impacts)
        lost_j = sum(
            errors_of(errors, i).get("plate_energy_j", 0.0) for i in range(len(metrics.impacts))
        )
        wrong += 10.0 / math.log(10.0) * lost_j / abs(energy_j) if energy_j else math.nan
    if not wrong <= _HARDLY_DB:
        return [_UNPREDICTABLE]
    energy = row_of(found.rows, "whole_run", "plate_energy_j")
    contacts = row_of(found.rows, "whole_run", "contacts")
    whole = energy.change if energy else None
    if first is None or whole is None or contacts is None or contacts.reference is None:
        return []
    if max(abs(whole.least - first.least), abs(whole.most - first.most)) <= MUCH_DB:
        return []
    with_, without = (uncertain_text(n, ".0f") for n in (contacts.value, contacts.reference))
    return [
        f"Over all contacts the change is {uncertain_text(whole, '+.1f')} dB, with {with_} contact"
        f"{'' if with_ == '1' else 's'} instead of {without}."
    ]


def _other_changes(rows: Rows) -> tuple[Rows, Rows]:
    """Return the other metrics of the first impact that are better, and those that are worse at
    every touch phase, the largest change first."""
    better, worse = [], []
    for row in sorted(rows, key=lambda row: -row.size):
        of_impact = row.span == "first_impact" and row.metric != "plate_energy_j"
        if not (of_impact and row.field.less_is_better and row.size > _HARDLY_DB):
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


def _change_words(row: MetricRow) -> str:
    """Return the name of a metric and its change, as in the table."""
    if row.from_zero:
        own, without = value_texts(row)
        return f"{row.label} {own} instead of {without}"
    return f"{row.label} {change_text(row)}"


def _reasons(result: RunResult, contact_s: float) -> list[str]:
    """State each reason why control does not help; `contact_s`: contact time without control."""
    push, reasons = result.metrics.push, []
    assert push is not None
    if push.after_touch_s / contact_s > _MUCH:
        reasons.append(
            f"the first force comes {quantity(push.after_touch_s, 's')} after contact begins "
            f"({100.0 * push.after_touch_s / contact_s:z.0f} % of it)"
        )
    if push.apart > _MUCH:
        reasons.append(f"{100.0 * push.apart:z.0f} % of the control impulse acts without contact")
    if result.injected_j > 0.0:
        reasons.append(f"the actuator adds {quantity(result.injected_j, 'J')} to the plate")
    if result.dent_m:
        reasons.append(
            f"the law takes the permanent dent of {1e6 * result.dent_m:.2g} um for penetration"
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
