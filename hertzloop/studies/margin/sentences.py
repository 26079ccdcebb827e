"""The margin of a loop in sentences."""

from hertzloop.studies.margin.binding import hertz, mode_line
from hertzloop.studies.margin.flight import Margin
from hertzloop.studies.margin.growth import Growth
from hertzloop.studies.margin.jitter import JitterMargin
from hertzloop.studies.margin.loop import NO_LAW
from hertzloop.studies.margin.margin import MarginResult

_SHOWS = 10.0  # e-folds from which a run shows an instability


def result_lines(found: MarginResult) -> list[str]:
    """Return all lines on a margin, the verdict first."""
    lines = [verdict_line(found), *margin_lines(found.flight), *jitter_lines(found.jitter)]
    at_hz = found.flight.binding_frequency_hz
    return lines if at_hz is None else [*lines, mode_line(found.binding_mode, at_hz)]


def verdict_line(found: MarginResult) -> str:
    """Return the verdict on a margin in one sentence."""
    m = found.flight
    if not m.applicable:
        return "The law has no linear loop in flight, so it has no margin."
    if not m.stable:
        return f"The loop is unstable in flight at {m.latency_us:g} us: {growth_words(m.growth)}."
    latency = "any latency"
    if m.latency_limit_us is not None:
        latency = f"a latency of up to {m.latency_limit_us:.4g} us"
    gain = "any gain" if m.gain_margin is None else f"{m.gain_margin:.4g} times its gain"
    return (
        f"The loop is stable in flight at {m.latency_us:g} us: it tolerates {latency}, or {gain}."
    )


def growth_words(found: Growth) -> str:
    """Return how an unstable loop grows, in a clause."""
    if found.unstable_poles is None:
        return "the number of poles outside the unit circle could not be decided"
    if found.per_s is None or found.frequency_hz is None or found.e_folds is None:
        return (
            f"{found.unstable_poles} poles outside the unit circle; their growth could not be "
            "decided"
        )
    return (
        f"grows {found.per_s:.4g}/s at {hertz(found.frequency_hz)}, e-folds over this run "
        f"{found.e_folds:.3g}"
    )


def unstable_line(found: Growth) -> str:
    """Return the warning on a run whose linear loop is unstable, after the word "unstable"."""
    short = found.e_folds is not None and found.e_folds < _SHOWS
    ends = "; the run is too short to show it" if short else ""
    return f"{growth_words(found)}{ends}. 'hertzloop margin' tells what limits the loop."


def margin_lines(m: Margin) -> list[str]:
    """Return the lines that describe a margin."""
    if not m.applicable:
        remedy = "Use 'hertzloop budget' to find how much latency the law tolerates."
        if m.reason == NO_LAW:
            remedy = "Name a law, for example --law velocity_feedback."
        return [f"No margin: {m.reason}.", remedy]
    lines = [f"Linear loop in flight, ideal converters, {m.modes} modes, step {m.step_ns} ns"]
    if not m.stable and m.growth_per_s is not None:
        lines.append(f"{m.unstable_poles} poles outside the unit circle")
    if m.latency_limit_steps is None:
        lines.append("latency limit: none")
    elif m.latency_limit_steps < 0:
        lines.append("latency limit: none is tolerated; the loop is unstable at latency 0")
    else:
        at = f", set at {hertz(m.binding_frequency_hz)}" if m.binding_frequency_hz else ""
        lines.append(
            f"latency limit: {m.latency_limit_steps} steps ({m.latency_limit_us:.4g} us){at}"
        )
    windows = m.stable_windows_us or []
    latencies = ", ".join(
        f"{a:.4g} to {'any' if b is None else format(b, '.4g')}" for a, b in windows[:8]
    )
    lines.append(f"stable latencies, us: {latencies or 'none'}{' ...' if len(windows) > 8 else ''}")
    gain = "without limit" if m.gain_margin is None else f"{m.gain_margin:.4g}"
    lines.append(f"gain margin (factor on the gain at which stability ends): {gain}")
    if m.peak_sensitivity is not None and m.disk_margin is not None:
        lines.append(f"peak sensitivity {m.peak_sensitivity:.4g}, disk margin {m.disk_margin:.4g}")
    return lines


def jitter_lines(found: JitterMargin | None) -> list[str]:
    """Return the lines on a latency that varies; none without a linear loop."""
    if found is None:
        return []
    lines = []
    if found.margin_steps is not None and found.frequency_hz is not None:
        lines += [
            f"jitter margin: {found.margin_steps} steps ({found.margin_us:.4g} us) above the "
            f"shortest latency, in any sequence, set at {hertz(found.frequency_hz)}",
            "the jitter margin is sufficient, not necessary; the latency limit is its upper bound",
        ]
    elif found.frequency_hz is not None:
        lines.append("jitter margin: without limit")
    if found.verdict == "certified":
        lines.append(
            f"the latencies of this scene: certified, {found.added_us:g} us above the shortest "
            "one at most"
        )
    elif found.verdict == "refuted":
        lines.append(
            "the latencies of this scene: refuted, unstable at a constant latency of "
            f"{found.refuted_at_us:g} us within their range"
        )
    elif found.verdict == "undecided":
        why = "the stability at the shortest latency is not known"
        if found.frequency_hz is not None:
            why = f"{found.added_us:g} us above the shortest one is beyond the jitter margin"
        if found.drops_out:
            why = "random drop-outs have no longest burst"
        lines.append(f"the latencies of this scene: undecided, because {why}")
    if found.drops_out and found.burst is not None:
        burst = "no burst" if found.burst < 0 else f"bursts of up to {found.burst} commands"
        lines.append(f"drop-outs: {burst} in a row certified at these latencies")
    return lines
