"""How a paced run kept up with the wall clock, and whether a repeated run gave the same bytes."""

from pathlib import Path

from rich.text import Text

from hertzloop.common.readable import quantity
from hertzloop.results.recorded import IN_TIME, PacedClock, Pacing
from hertzloop.views.format import unwrapped


def lateness_sentences(found: Pacing) -> list[str]:
    """State the share of late forces, and the pace that this machine supports."""
    missed = (
        f"{100 * found.share_late:.2g} % of {found.steps:,} forces came late, at most "
        f"{found.longest_sequence:,} in a row"
    )
    if not found.late_forces:
        missed = f"None of {found.steps:,} forces came late"
    clock = found.clock
    if clock is not None:
        return [f"Pace {clock.pace:g}: {missed}.", _pacing_advice(clock)]
    if found.is_repeat:
        return [f"{missed}, as in the run that this one repeats."]
    return [
        f"{missed} in what was recorded; the response times, which the plant tells at the end "
        "of a run, are not in it."
    ]


def pacing_sentences(found: Pacing) -> list[str]:
    """State missed deadlines, the pace that this machine supports, and response times."""
    clock = found.clock
    if clock is None:
        return lateness_sentences(found)
    worst = f"The worst force came {_time(clock.late_max_us)} late; the plant itself was"
    if not found.late_forces:
        worst = "The plant itself was"
    return [
        *lateness_sentences(found),
        f"{worst} at most {_time(clock.behind_max_us)} behind the clock.",
        "From a sample to its answer: "
        + ", ".join(f"{name} {_time(us)}" for name, us in clock.response_us.items())
        + f" (of {_time(clock.slack_us)} that this pace leaves).",
    ]


def _pacing_advice(found: PacedClock) -> str:
    """Recommend a pace, a latency or another computer."""
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


def pacing_lines(found: Pacing | None, details: bool = False) -> list[Text]:
    """Return sentences on missed deadlines, with response times for `details`; none for a run in
    lock-step."""
    if found is None:
        return []
    sentences = pacing_sentences(found) if details else lateness_sentences(found)
    return [Text(sentence) for sentence in sentences]


def repetition_lines(repeats: Path | None, differs: str | None) -> list[Text]:
    """Return a sentence on a repeated run; none for another.

    Args:
        repeats: Recording that the run repeats.
        differs: First difference from that recording, if there is one.
    """
    if repeats is None:
        return []
    if differs:
        return [unwrapped((f"Repeated: not the run in {repeats}: {differs}.", "red"))]
    return [unwrapped((f"Repeated: the same bytes as in {repeats}.", "bold"))]


def _time(us: float) -> str:
    """Return a time in us to two digits."""
    return quantity(float(f"{us:.2g}") * 1e-6, "s")
