"""The margin of a loop as a picture: loop gain and Nyquist plot."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.binding import mode_name
from hertzloop.studies.margin.loop import PolyphaseLoop, loops_of
from hertzloop.studies.margin.margin import MarginResult
from hertzloop.studies.margin.table import Loop
from hertzloop.studies.pages import pictures

_RADIUS = 3.5  # of the Nyquist plot at most; resonances leave it, the neighbourhood of -1 stays
_BLUE, _ORANGE, _, _PINK = pictures.COLOURS[:4]


def draw(setup: Setup, result: MarginResult) -> Figure:
    """Draw the loop gain and the Nyquist plot at the latency of the scene.

    Args:
        setup: the run.
        result: its margin, which applies.
    """
    margin = result.flight
    loops = loops_of(setup)
    assert isinstance(loops, PolyphaseLoop)
    loop, delay = loops.at(setup.signal_path.latency_steps)
    sheet, axes = pictures.sheet(1, 2, width=12.0, height=4.2)
    state = "stable" if margin.stable else "unstable"
    sheet.suptitle(
        f"{setup.scene.name}, law {loaded_law(setup).name}: loop in flight, {state} at a latency "
        f"of {margin.latency_us:g} us"
    )
    _gain(axes[0, 0], loop, setup, result)
    _nyquist(axes[0, 1], loop, delay, margin.peak_sensitivity)
    return sheet


def _gain(ax: Any, loop: Loop, setup: Setup, result: MarginResult) -> None:
    """Draw |L| over frequency, and the frequency that limits the loop with its mode."""
    theta, sample_s = loop.table.theta, setup.sensor.every_steps * setup.run.step_s
    shown = theta > 0.0
    at_hz, size = theta[shown] / (2.0 * math.pi * sample_s), loop.table.log_gain.real[shown]
    size = np.exp(np.clip(size, -60.0, 60.0))
    ax.loglog(at_hz, size, color=_BLUE, linewidth=0.9)
    ax.axhline(1.0, color="#444444", linestyle="--", linewidth=1.0)
    first = float(np.abs(np.log(loop.plant.poles)).min()) / (2.0 * math.pi * sample_s)
    ax.set_xlim(0.3 * first, at_hz[-1])
    seen = size[at_hz > 0.3 * first]
    ax.set_ylim(max(seen.min(), 1e-5 * seen.max()), 3.0 * seen.max())
    binding_hz, mode = result.flight.binding_frequency_hz, result.binding_mode
    if binding_hz is not None:
        name = f"\n{mode_name(mode)}" if mode else ""
        label = f"binding: {binding_hz:.4g} Hz{name}"
        ax.axvline(binding_hz, color=_ORANGE, linestyle=":", label=label)
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


def _nyquist(ax: Any, loop: Loop, delay: int, peak: float | None) -> None:
    """Draw L with its delay, and the circle of its closest approach to -1."""
    theta = loop.table.theta
    most = 4.0 * math.pi / max(delay, 1)  # the delay turns between two points
    parts = [np.linspace(a, b, 2 + int(40.0 * (b - a) / most))[:-1] for a, b in pairwise(theta)]
    value = _curved(loop.delayed(np.concatenate([*parts, theta[-1:]]), delay))
    ax.plot(value.real, value.imag, color=_BLUE, linewidth=0.5, label="L")
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
