"""The HTML page of a fit, which needs no other file."""

import math
from typing import Any

import numpy as np

from hertzloop.fitting.fit.reports.fit_text import number, sentences, touch_s
from hertzloop.fitting.fit.reports.fitted_scene import fitted_scene
from hertzloop.fitting.fit.results import FitResult, Nuisance
from hertzloop.fitting.fit.verdicts import ModelVerdict
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.recordings.replay.decimation import extremes
from hertzloop.studies.cases.identity import code_version
from hertzloop.studies.pages import pictures
from hertzloop.studies.pages.html import ResultChart, ResultPage, ResultTable, svg

_MOST_POINTS = 1500  # of a curve
_DOTS = {"markersize": 3, "color": pictures.COLOURS[0]}
_LINE = {"color": pictures.COLOURS[1], "linewidth": 1.2}
_BEFORE, _AFTER = 0.5, 3.0  # contact times that the zoom shows
_USUAL = 2.0  # of the noise: nearly all residuals of a right model are within


def page(result: FitResult, command: str) -> str:
    """Return the page: keys, records, covariance, measured over simulated values, residuals.

    Args:
        result: a fit or a check.
        command: the command that makes the page again.
    """
    said = sentences(result)
    doubtful = result.reasons if result.model is ModelVerdict.DOES_NOT_FIT else []
    names = ", ".join(r.name for r in result.records)
    scene = [] if result.setup is None else [(result.setup.name, fitted_scene(result, "fitted"))]
    return ResultPage(
        title=f"{'Check' if result.checked_only else 'Fit'} of {names}",
        lines=[line for line in said if line not in doubtful],
        charts=_charts(result),
        tables=_tables(result),
        warnings=doubtful,
        commands=[command],
        versions=code_version(),
        scenes=scene,
    ).html()


def _tables(result: FitResult) -> list[ResultTable]:
    keys = ("key", "value", "low, 95 %", "high, 95 %", "start", "verdict")
    rows = [
        [e.key, number(e.value, 6), number(e.low), number(e.high), number(e.start), str(e.verdict)]
        for e in result.estimates
    ]
    of_records = (
        "record",
        "gain",
        "offset",
        "touch, s",
        "clock, ppm",
        "noise",
        "residual over noise",
    )
    records = [
        [
            n.record,
            f"{n.gain:.5g}",
            f"{n.offset:.4g}",
            touch_s(n, record),
            f"{n.clock_ppm:.3g}",
            f"{n.noise_rms:.3g}",
            f"{n.residual_over_noise:.3g}",
        ]
        for n, record in zip(result.nuisances, result.records, strict=True)
    ]
    tables = [ResultTable("Keys", keys, rows), ResultTable("Records", of_records, records)]
    if len(result.estimates) > 1:
        names = [e.key for e in result.estimates]
        shared = [[key, *line] for key, line in zip(names, _correlations(result), strict=True)]
        tables.append(ResultTable("Correlation of the keys' logarithms", ("", *names), shared))
    return tables


def _correlations(result: FitResult) -> list[list[str]]:
    sd = np.sqrt(np.diag(result.covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = result.covariance / np.outer(sd, sd)
    return [[f"{x:.3f}" if math.isfinite(x) else "-" for x in line] for line in found.tolist()]


def _charts(result: FitResult) -> list[ResultChart]:
    found = []
    for record, n, curve in zip(result.records, result.nuisances, result.curves, strict=False):
        assert result.setup is not None
        base = result.setup.vary(dict(record.measurement.set))
        contact_s = rigid_impact(base.sphere, base.contact).contact_s
        words = (
            f"Left: around the contact. Right: the whole record. The shaded time is the first "
            f"contact of a rigid structure, {1e6 * contact_s:.3g} us. The lower band is "
            f"{_USUAL:g} times the noise wide on each side."
        )
        drawn = svg(_draw_record(record, n, curve, 1e6 * contact_s))
        found.append(ResultChart(record.name, drawn, words))
    return found


def _draw_record(
    record: Record, n: Nuisance, curve: dict[str, np.ndarray], contact_us: float
) -> Any:
    """Measured over simulated values, and the residual below, around the contact and in whole."""
    sheet, axes = pictures.sheet(2, 2, width=10.0, height=2.6)
    time_us, used = 1e6 * curve["time_s"], curve["used"]
    residual = (curve["measured"] - curve["simulated"]) / n.noise_rms
    around = (time_us > -_BEFORE * contact_us) & (time_us < _AFTER * contact_us)
    unit = QUANTITIES[record.quantity].unit
    for column, inside in enumerate((around, np.ones_like(around))):
        upper, lower = axes[:, column]
        line = _decimated_places(inside, curve["simulated"])
        dots = _decimated_places(inside & used, curve["measured"])
        left = _decimated_places(inside & used, residual)
        upper.plot(time_us[dots], curve["measured"][dots], ".", label="measured", **_DOTS)
        upper.plot(time_us[line], curve["simulated"][line], label="simulated", **_LINE)
        upper.set(ylabel=f"{record.quantity} ({unit})")
        lower.axhspan(-_USUAL, _USUAL, color="#dfe4ec", label=f"{_USUAL:g} times the noise")
        lower.plot(time_us[left], residual[left], ".", label="residual", **_DOTS)
        lower.set(ylabel="residual over noise")
        for ax in (upper, lower):
            ax.axvspan(0.0, contact_us, color="#ff9a00", alpha=0.18, label="contact")
            ax.set(xlabel="time after the first touch (us)")
        if column == 0:
            upper.set(title="Around the contact")
            for ax in (upper, lower):
                ax.set_xlim(-_BEFORE * contact_us, _AFTER * contact_us)
        else:
            upper.set(title="Whole record")
            for ax in (upper, lower):
                ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=7)
    return sheet


def _decimated_places(kept: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Places of kept values, of very many those that show the least and the largest."""
    places = np.flatnonzero(kept)
    return np.asarray(places[extremes(values[places], _MOST_POINTS)]) if len(places) else places
