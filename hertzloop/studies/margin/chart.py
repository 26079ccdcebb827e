"""The margin of a loop as a picture of four panels."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.binding import binding_mode, mode_name
from hertzloop.studies.margin.flight import Margin
from hertzloop.studies.margin.loop import PolyphaseLoop, loops_of
from hertzloop.studies.margin.poles import closed_loop_poles
from hertzloop.studies.pages import pictures

_MOST_POLES = 4000
_LATENCIES = 24  # at which the growth is computed
_FEWEST, _MOST = 24, 4000  # steps of latency that the last panel shows
_RADIUS = 3.5  # of the Nyquist plot at most; resonances leave it, the neighbourhood of -1 stays
_REAL = 1e-12  # imaginary part up to which a pole counts as real
_LINEAR = 10.0  # growth, 1/s, up to which the scale of the third panel is linear
_BLUE, _ORANGE, _GREEN, _PINK = pictures.COLOURS[:4]


class _Drawn:
    """What all panels need: the loops of a setup by latency, and its margin."""

    def __init__(self, setup: Setup, margin: Margin) -> None:
        self.setup, self.margin = setup, margin
        loops = loops_of(setup)
        assert isinstance(loops, PolyphaseLoop)
        self.at = loops.at
        self.sample_s = setup.every_steps * setup.step_s
        self.latency = setup.line.latency_steps

    def poles(self, latency: int) -> np.ndarray | None:
        """Return all closed-loop poles for a latency in steps; None if they are too many."""
        loop, delay = self.at(latency)
        if 2 * len(loop.plant.poles) + delay > _MOST_POLES:
            return None
        return closed_loop_poles(loop.plant, loop.law, delay)

    def fastest(self, latency: int) -> float | None:
        """Return the growth of the fastest pole for a latency in steps, 1/s; None if unknown. Where
        the poles are too many, the margin knows that of an unstable loop at its own latency."""
        poles = self.poles(latency)
        if poles is not None:
            return float(self.growth(poles)[1].max())
        return (self.margin.growth_per_s or None) if latency == self.latency else None

    def growth(self, poles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return frequency (kHz) and growth (1/s) of poles in the upper half plane."""
        # The imaginary part of a real pole is a rounding of either sign.
        upper = poles[(poles.imag > -_REAL) & (np.abs(poles) > 1e-12)]
        s = np.log(upper) / self.sample_s
        return np.abs(s.imag) / (2e3 * math.pi), s.real

    def label(self) -> str:
        at_hz = self.margin.binding_frequency_hz
        if at_hz is None:
            return ""
        mode = binding_mode(self.setup, at_hz)
        name = f"\n{mode_name(mode)}" if mode else ""
        return f"binding: {at_hz:.4g} Hz{name}"


def draw(setup: Setup, margin: Margin) -> Figure:
    """Draw loop gain, Nyquist plot, closed-loop poles, and growth over latency.

    Args:
        setup: the run.
        margin: its margin, which applies.
    """
    drawn = _Drawn(setup, margin)
    sheet, axes = pictures.sheet(2, 2, width=12.0, height=4.2)
    state = "stable" if margin.stable else "unstable"
    sheet.suptitle(
        f"{setup.name}, law {loaded_law(setup).name}: loop in flight, {state} at a latency of "
        f"{margin.latency_us:g} us"
    )
    _gain(axes[0, 0], drawn)
    _nyquist(axes[0, 1], drawn)
    _poles(axes[1, 0], drawn)
    _latencies(axes[1, 1], drawn)
    return sheet


def _gain(ax: Any, drawn: _Drawn) -> None:
    loop, _ = drawn.at(drawn.latency)
    theta = loop.table.theta
    shown = theta > 0.0
    at_hz, size = theta[shown] / (2.0 * math.pi * drawn.sample_s), loop.table.log_gain.real[shown]
    size = np.exp(np.clip(size, -60.0, 60.0))
    ax.loglog(at_hz, size, color=_BLUE, linewidth=0.9)
    ax.axhline(1.0, color="#444444", linestyle="--", linewidth=1.0)
    first = float(np.abs(np.log(loop.plant.poles)).min()) / (2.0 * math.pi * drawn.sample_s)
    ax.set_xlim(0.3 * first, at_hz[-1])
    seen = size[at_hz > 0.3 * first]
    ax.set_ylim(max(seen.min(), 1e-5 * seen.max()), 3.0 * seen.max())
    if drawn.label():
        ax.axvline(
            drawn.margin.binding_frequency_hz, color=_ORANGE, linestyle=":", label=drawn.label()
        )
        ax.legend(loc="lower left")
    ax.set(
        xlabel="frequency (Hz)",
        ylabel="loop gain |L|",
        title="Loop gain; only above 1 (dashed) can the loop become unstable",
    )


def _curved(value: np.ndarray) -> np.ndarray:
    """A complex number with its magnitude r replaced by log2(1 + r)."""
    size = np.abs(value)
    return np.asarray(value * np.log2(1.0 + size) / np.where(size == 0.0, 1.0, size))


def _nyquist(ax: Any, drawn: _Drawn) -> None:
    loop, delay = drawn.at(drawn.latency)
    theta = loop.table.theta
    most = 4.0 * math.pi / max(delay, 1)  # the delay turns between two points
    parts = [np.linspace(a, b, 2 + int(40.0 * (b - a) / most))[:-1] for a, b in pairwise(theta)]
    z = np.exp(1j * np.concatenate([*parts, theta[-1:]]))
    value = _curved(loop.gain(z) * z ** -float(delay))
    ax.plot(value.real, value.imag, color=_BLUE, linewidth=0.5, label="L")
    peak = drawn.margin.peak_sensitivity
    radius = 1.0 / peak if peak else 0.5
    circle = _curved(-1.0 + radius * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 300)))
    label = f"|1 + L| = {radius:.3g}" + (", closest approach" if peak else "")
    ax.plot(circle.real, circle.imag, color=_ORANGE, label=label)
    ax.plot(-1.0, 0.0, "+", color=_PINK, markersize=11, markeredgewidth=2, label="-1")
    size = min(max(1.8, 1.1 * float(np.abs(value).max())), _RADIUS)
    ax.set(
        xlim=(-size, size),
        ylim=(-size, size),
        aspect="equal",
        xlabel="real part",
        ylabel="imaginary part",
        title="Nyquist plot, radius log2(1 + |L|)",
    )
    ax.legend(loc="upper right")


def _poles(ax: Any, drawn: _Drawn) -> None:
    margin, loop = drawn.margin, drawn.at(drawn.latency)[0]
    series = [("no control", drawn.growth(loop.plant.poles), _GREEN, ".")]
    limit = margin.latency_limit_steps
    cases = [(drawn.latency, f"latency {margin.latency_us:g} us (this scene)", _BLUE, "o")]
    if limit is not None and limit >= 0 and limit + 1 != drawn.latency:
        beyond_us = 1e6 * drawn.setup.step_s * (limit + 1)
        cases.append((limit + 1, f"latency {beyond_us:.4g} us, beyond the limit", _ORANGE, "x"))
    for latency, label, colour, marker in cases:
        found = drawn.poles(latency)
        if found is not None:
            series.append((label, drawn.growth(found), colour, marker))
    for label, (at_khz, growth), colour, marker in series:
        face = {} if marker == "x" else {"markerfacecolor": "none"}
        ax.plot(
            at_khz, growth, marker, color=colour, markersize=4, linewidth=0.0, label=label, **face
        )
    ax.axhline(0.0, color="#444444", linewidth=1.0)
    decay = float(np.percentile(-series[0][1][1], 98))  # filters decay far quicker
    growing = max(float(g.max(initial=0.0)) for _, (_, g), _, _ in series)
    ax.set_yscale("symlog", linthresh=_LINEAR)
    ax.set_ylim(-10.0 * max(decay, growing, _LINEAR), max(5.0 * growing, 2.0 * _LINEAR))
    ax.set_xscale("log")
    lowest = series[0][1][0]
    ax.set_xlim(0.5 * float(lowest[lowest > 0.0].min()), 0.5e-3 / drawn.sample_s)
    ax.set(
        xlabel="frequency (kHz)",
        ylabel="growth (1/s)",
        title="Closed-loop poles; above 0 the loop is unstable",
    )
    ax.legend(loc="lower left")


def _latencies(ax: Any, drawn: _Drawn) -> None:
    margin, step_us = drawn.margin, 1e6 * drawn.setup.step_s
    limit = margin.latency_limit_steps
    last = max(_FEWEST, 2 * drawn.latency, 0 if limit is None else 2 * limit)
    last = min(last, _MOST)
    every = np.unique(np.linspace(0, last, 400).astype(int))
    count = []
    for latency in every.tolist():
        loop, delay = drawn.at(latency)
        count.append(int(loop.table.unstable(np.array([delay]))[0]))
    chosen = set(np.linspace(0, last, _LATENCIES).astype(int).tolist()) | {drawn.latency}
    if limit is not None and 0 <= limit < last:
        chosen |= {limit, limit + 1}
    at, growth = [], []
    for latency in sorted(chosen):
        fastest = drawn.fastest(latency)
        if fastest is not None:
            at.append(latency * step_us)
            growth.append(fastest)
    for i, (first, end) in enumerate(margin.stable_windows_us or []):
        ax.axvspan(
            first,
            last * step_us if end is None else min(end, last * step_us),
            color=_GREEN,
            alpha=0.15,
            linewidth=0,
            label=None if i else "stable",
        )
    if at:
        ax.plot(at, growth, "-o", color=_BLUE, markersize=4, label="fastest growth")
    ax.axhline(0.0, color="#444444", linewidth=1.0)
    ax.axvline(margin.latency_us, color=_PINK, linestyle="--", label="latency of this scene")
    ax.set(
        xlabel="latency (us)",
        ylabel="growth of the fastest pole (1/s)",
        xlim=(-0.02 * last * step_us, last * step_us),
        title="Growth and number of unstable poles over latency",
    )
    other = ax.twinx()
    other.step(every * step_us, count, where="mid", color=_ORANGE, linewidth=1.0, linestyle="--")
    other.set_ylabel("unstable poles (dashed orange)")
    other.set_ylim(bottom=0)
    other.yaxis.set_major_locator(MaxNLocator(integer=True))
    other.grid(visible=False)
    ax.legend(loc="upper left" if margin.stable else "lower right")
