"""The three charts of a report: around the first contact, over the whole run, and spectra."""

import io
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hertzloop.recordings.replay.decimation import extremes
from hertzloop.recordings.replay.plots import Plot, PlotCurve
from hertzloop.recordings.replay.replay_data import ReplayData
from hertzloop.studies.pages import pictures

_POINTS = 1500  # a curve
_STYLES = {"F_a": 2, "F_c": 1, "measured": 4, "fed": 2, "contact": 1, "plate": 3}


def charts_of(shown: ReplayData) -> dict[str, str]:
    """Return those charts that a run has, by title, as SVG elements."""
    truth, found = shown.recording.truth, {}
    if shown.contacts:
        found["First contact"] = _sheet(shown.plots, shown.when.around_ns)
    found["Whole run"] = _sheet(shown.plots, (0, (truth.samples - 1) * truth.step_ns))
    if shown.labels.spectra:
        found["Plate velocity at the contact, whole run"] = _spectra(shown)
    return found


def _svg(sheet: Figure) -> str:
    """Return a figure as an SVG element, without the document around it."""
    text = io.StringIO()
    sheet.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    whole = text.getvalue()
    return whole[whole.index("<svg") :]


def _spectra(shown: ReplayData) -> str:
    """Draw the level of the plate velocity."""
    sheet, axes = pictures.sheet(1, 1, width=10.0, height=2.8)
    ax = axes[0, 0]
    for i, found in enumerate(shown.labels.spectra):
        ax.semilogx(found.frequency_hz, found.level_db, label=found.label, **pictures.look(i))
    ax.set(xlabel="frequency (Hz)", ylabel="level in 1/12 octaves\n(dB re 1 m/s)")
    _legend(ax)
    return _svg(sheet)


def _sheet(plots: list[Plot], span_ns: tuple[int, int]) -> str:
    """Draw all curves over a span of time."""
    lines = -(-len(plots) // 2)
    sheet, axes = pictures.sheet(lines, 2, width=10.0, height=2.4)
    for ax, plot in zip(axes.ravel(), plots, strict=False):
        for curve in plot.curves:
            _draw(ax, curve, span_ns)
        limits = tuple(1e-6 * t for t in span_ns)
        ax.set(title=plot.title, xlabel="simulated time (ms)", xlim=limits)
        if plot.most is not None:
            ax.set_ylim(-plot.most, plot.most)
        _legend(ax)
    for ax in axes.ravel()[len(plots) :]:
        ax.remove()
    return _svg(sheet)


def _draw(ax: Any, curve: PlotCurve, span_ns: tuple[int, int]) -> None:
    times, values = curve.time_ns, curve.values
    a, b = np.searchsorted(times, span_ns)
    if b - a >= len(times) - 1 and curve.overview is not None:  # all of it, evenly
        times, values = times[curve.overview], values[curve.overview]
    else:
        times, values = times[a : b + 1], values[a : b + 1]
    if not len(values) or not np.isfinite(values).any():
        return
    chosen = extremes(np.nan_to_num(values), _POINTS)
    style = pictures.look(_STYLES.get(curve.name, 0))
    style = {"color": "#888888", "linestyle": "--", "linewidth": 1.1} if curve.faint else style
    ax.plot(1e-6 * times[chosen], values[chosen], label=curve.label or curve.name, **style)


def _legend(ax: Any) -> None:
    """Draw the legend beside the axes, where it hides nothing."""
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, fontsize=7)
