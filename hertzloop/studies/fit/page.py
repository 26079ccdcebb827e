"""The HTML page of a fit, which needs no other file, and a replay of measured over simulated."""

import html
import math
from pathlib import Path

import numpy as np

from hertzloop.studies.fit.fit import FitResult
from hertzloop.studies.fit.records import QUANTITIES
from hertzloop.studies.fit.report import number, sentences

_WIDTH, _HEIGHT, _MARGIN = 860, 240, 46
_MOST_POINTS = 3000
_STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:62em;margin:2em auto;padding:0 1em}
table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:.25em .6em;text-align:right}
td:first-child,th:first-child{text-align:left}svg{background:#fafafa;border:1px solid #ddd}
.m{fill:#1f6fb2}.s{stroke:#d1495b;fill:none;stroke-width:1.5}.r{stroke:#555;fill:none}
text{font-size:12px;fill:#333}"""


def page(result: FitResult) -> str:
    """Return the page: keys, records, covariance, measured over simulated values, residuals."""
    names = html.escape(", ".join(r.name for r in result.records))
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'>",
        f"<title>Fit of {names}</title><style>{_STYLE}</style><h1>Fit of {names}</h1>",
        "<p>" + "<br>".join(html.escape(s) for s in sentences(result)) + "</p>",
        "<h2>Keys</h2>",
        _table(
            ("key", "value", "low, 95 %", "high, 95 %", "verdict"),
            [(e.key, number(e.value, 6), number(e.low), number(e.high), str(e.verdict))
             for e in result.estimates],
        ),
    ]  # fmt: skip
    if len(result.estimates) > 1:
        parts += ["<h2>Correlation of the keys' logarithms</h2>", _correlation(result)]
    parts += [
        "<h2>Records</h2>",
        _table(
            ("record", "gain", "offset", "touch, s", "clock, ppm", "noise", "residual/noise"),
            [(n.record, f"{n.gain:.5g}", f"{n.offset:.4g}", f"{n.time_shift_s:.9g}",
              f"{n.clock_ppm:.3g}", f"{n.noise_rms:.3g}", f"{n.residual_over_noise:.3g}")
             for n in result.nuisances],
        ),
    ]  # fmt: skip
    for record, curve in zip(result.records, result.curves, strict=False):
        unit = QUANTITIES[record.quantity].unit
        parts.append(f"<h2>{html.escape(record.name)}</h2>")
        parts.append(
            f"<p>Measured (dots) and simulated (line) {record.quantity}, {unit}, over the time "
            "after the first touch, us; below, the residual.</p>"
        )
        step = max(1, len(curve["time_s"]) // _MOST_POINTS)
        time_us = 1e6 * curve["time_s"][::step]
        measured, simulated = curve["measured"][::step], curve["simulated"][::step]
        used = curve["used"][::step]
        parts.append(_plot(time_us, simulated, measured, used, "s"))
        parts.append(_plot(time_us, np.where(used, measured - simulated, 0.0), None, used, "r"))
    return "\n".join([*parts, "</html>"])


def _table(headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    head = "".join(f"<th>{html.escape(h)}</th>" for h in headings)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _correlation(result: FitResult) -> str:
    keys = [e.key for e in result.estimates]
    sd = np.sqrt(np.diag(result.covariance))
    rows = []
    for i, key in enumerate(keys):
        cells = []
        for j in range(len(keys)):
            value = float(result.covariance[i, j] / (sd[i] * sd[j])) if sd[i] * sd[j] else math.nan
            cells.append(f"{value:.3f}" if math.isfinite(value) else "-")
        rows.append((key, *cells))
    return _table(("", *keys), rows)


def _plot(
    x: np.ndarray, line: np.ndarray, dots: np.ndarray | None, used: np.ndarray, name: str
) -> str:
    """A plot as SVG."""
    values = line if dots is None else np.concatenate([line, dots[used]])
    low, high = float(np.min(values)), float(np.max(values))
    if high <= low:
        high = low + 1.0
    left, right = float(x[0]), float(x[-1])
    across = _MARGIN + (x - left) / (right - left) * (_WIDTH - 2 * _MARGIN)

    def up(y: np.ndarray) -> np.ndarray:
        return np.asarray(_HEIGHT - 24 - (y - low) / (high - low) * (_HEIGHT - 40))

    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up(line), strict=True))
    shapes = [f"<polyline class='{name}' points='{points}'/>"]
    if dots is not None:
        shapes += [
            f"<circle class='m' cx='{a:.1f}' cy='{b:.1f}' r='1.3'/>"
            for a, b, u in zip(across, up(dots), used, strict=True) if u
        ]  # fmt: skip
    shapes += [
        f"<text x='2' y='14'>{high:.3g}</text>", f"<text x='2' y='{_HEIGHT - 26}'>{low:.3g}</text>",
        f"<text x='{_MARGIN}' y='{_HEIGHT - 6}'>{left:.4g} us</text>",
        f"<text x='{_WIDTH - 2 * _MARGIN}' y='{_HEIGHT - 6}'>{right:.4g} us</text>",
    ]  # fmt: skip
    return f"<svg width='{_WIDTH}' height='{_HEIGHT}'>{''.join(shapes)}</svg>"


def write_replay(result: FitResult, path: Path) -> None:
    """Write a Rerun recording (.rrd) with measured and simulated values of every record."""
    import rerun as rr

    stream = rr.RecordingStream("hertzloop_fit")
    stream.save(str(path))
    for record, curve in zip(result.records, result.curves, strict=False):
        times = [rr.TimeColumn("after_touch", duration=curve["time_s"])]
        for name in ("simulated", "measured"):
            stream.send_columns(
                f"{record.name}/{record.quantity}/{name}", indexes=times,
                columns=rr.Scalars.columns(scalars=curve[name]),
            )  # fmt: skip
        stream.send_columns(
            f"{record.name}/residual", indexes=times,
            columns=rr.Scalars.columns(scalars=curve["measured"] - curve["simulated"]),
        )  # fmt: skip
    stream.flush()
