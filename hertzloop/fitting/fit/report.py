"""A fit as text, as JSON, as a scene with a `[fit]` table, and as a picture."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.fitting.fit.results import (
    OPEN,
    WIDEST,
    Estimate,
    FitResult,
    KeyVerdict,
    ModelVerdict,
    Nuisance,
)
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.scene.tables import FitTable
from hertzloop.scene.toml import to_toml
from hertzloop.views.format import Table

_SHOWN = 5  # samples of a record
_MODEL_WORDS = {
    ModelVerdict.FITS: "The model fits.",
    ModelVerdict.DOES_NOT_FIT: "The model does not fit.",
    ModelVerdict.CANNOT_TELL: "The records cannot tell whether the model fits.",
}


def _percent(value: float) -> str:
    return f"{value:.2g} %" if value < 100.0 else f"{value:z.0f} %"


def number(value: float | None, digits: int = 5) -> str:
    """Write a number, or "open" for the end of an interval that is open."""
    return OPEN if value is None else f"{value:.{digits}g}"


def touch_s(nuisance: Nuisance, record: Record) -> str:
    """Write the time of the touch, s, with the digits that the samples of a record resolve."""
    return f"{nuisance.time_shift_s:.{max(0, math.ceil(-math.log10(record.interval_s)))}f}"


def describe_record(one: Record) -> list[str]:
    """Return sentences on a record: what was read, its first samples, and its peak."""
    unit = QUANTITIES[one.quantity].unit
    first = zip(one.time_s[:_SHOWN], one.value[:_SHOWN], strict=True)
    peak = int(np.nanargmax(np.abs(one.value)))
    return [
        f"{one.name}: {one.source}.",
        f"{len(one.value)} samples, {1e6 * one.interval_s:.6g} us from sample to sample; largest "
        f"value {one.value[peak]:.6g} {unit} at {one.time_s[peak]:.9g} s. The first samples:",
        *(f"  {t:.9g} s  {v:.6g} {unit}" for t, v in first),
        *one.notes,
    ]


def parameter_table(result: FitResult) -> Table:
    """Return the table of keys, estimates, intervals and verdicts."""
    title = "What the records can tell" if result.checked_only else "Fitted keys"
    table = Table(title=title)
    for heading in ("key", "value", "95 % interval", "+/-", "verdict"):
        table.add_column(heading, justify="left" if heading in ("key", "verdict") else "right")
    for e in result.estimates:
        half = e.half_width_percent
        width = "-" if half is None else f"{half:.2g} %" if half < 1e3 else "no bound"
        interval = f"{number(e.low)} to {number(e.high)}"
        table.add_row(e.key, number(e.value, 6), interval, width, str(e.verdict))
    return table


def sentences(result: FitResult) -> list[str]:
    """Return what a fit comes to, in sentences."""
    found = list(result.notes)
    for e in result.estimates:
        if e.verdict is KeyVerdict.ONE_SIDED:
            limit = f"at least {number(e.low)}" if e.high is None else f"at most {number(e.high)}"
            low, high = result.speeds_m_s
            found.append(
                f"{e.key} is {limit} (95 %): the records, at impact speeds of {low:.3g} to "
                f"{high:.3g} m/s, set no limit on the other side."
            )
        if e.resolution is not None:
            found.append(
                f"{e.key} is fitted in steps of {e.resolution:g} us, and its interval reaches half "
                "a step beyond the values that explain the records."
            )
    found += _unidentified_sentences(result)
    if result.checked_only:
        return found
    found.append(
        f"Residual over noise: {result.residual_over_noise:.3g}. {_MODEL_WORDS[result.model]}"
    )
    found += result.reasons
    found += [
        _accuracy_sentence(n.record, n.in_pulse_percent, n.after_pulse_percent, n.largest_percent)
        for n in result.nuisances
    ]
    if any(
        n.discrepancy_in_pulse_percent or n.discrepancy_after_pulse_percent
        for n in result.nuisances
    ):
        errors = "; ".join(
            f"{n.record}: {_percent(n.discrepancy_in_pulse_percent)} in the pulse and "
            f"{_percent(n.discrepancy_after_pulse_percent)} after it"
            for n in result.nuisances
        )
        found.append(
            f"The model is not exact. Its error, of the local signal, is estimated with the keys, "
            f"and the intervals include it. {errors}."
        )
    held = result.hold_out
    if held is not None:
        found.append(f"Held-out records: residual over noise {held['residual_over_noise']:.3g}.")
        ends = ("in_pulse_percent", "after_pulse_percent", "largest_percent")
        parts = held["records"], *(held[end] for end in ends)
        found += [
            _accuracy_sentence(f"{name} (held out)", *off)
            for name, *off in zip(*parts, strict=True)
        ]
    for n, record in zip(result.nuisances, result.records, strict=True):
        found.append(
            f"{n.record}: touch at {touch_s(n, record)} s, gain {n.gain:.4g}, offset "
            f"{n.offset:.3g}, clock {n.clock_ppm:+.3g} ppm, noise {n.noise_rms:.3g}."
        )
    if not math.isnan(result.wall_s):
        found.append(f"{result.evaluations} simulations in {result.wall_s:z.2f} s.")
    return found


def _accuracy_sentence(
    record: str, pulse: float | None, after: float | None, largest: float | None
) -> str:
    """The second part of the verdict: how far the simulation is from a record."""
    parts = [
        f"{_percent(off)} of the peak {where}"
        for off, where in ((pulse, "in the pulse"), (after, "after it"))
        if off is not None
    ]
    most = "" if largest is None else f"; largest error {_percent(largest)}"
    return f"{record}: good to {' and '.join(parts)} (root mean square{most})."


def _unidentified_sentences(result: FitResult) -> list[str]:
    """Name the keys that the records cannot tell, each with the reason."""
    keys = [e for e in result.estimates if e.verdict is KeyVerdict.NOT_IDENTIFIABLE]
    if not keys:
        return []
    return [
        f"Not identifiable from these records: {', '.join(e.key for e in keys)}.",
        *(_why_unidentified(e, len(result.estimates) > 1) for e in keys),
    ]


def _why_unidentified(e: Estimate, others: bool) -> str:
    if e.resolution is not None:
        return f"{e.key}: the records allow {number(e.low)} to {number(e.high)}."
    half, alone = e.half_width_percent, e.alone_percent
    if half is None or half >= 1e3:
        known = f"{e.key}: the records set no useful bound"
    else:
        known = f"{e.key}: the half-width is {_percent(half)}, more than {100.0 * WIDEST:g} %"
    if not others:
        return f"{known}."
    if alone is None or alone > 100.0 * WIDEST:
        return f"{known}, even if the other keys are known."
    return f"{known}. It falls to {_percent(alone)} if the other keys are known."


def as_json(result: FitResult) -> dict[str, Any]:
    """Return a fit as data for JSON: see docs/reference/fit-json.md for the fields."""
    by_record = {n.record: _nuisance_json(n) for n in result.nuisances}
    first = next(iter(by_record.values()))
    keys = ("time_shift_s", "gain", "offset", "clock_ppm")
    return {
        "parameters": {e.key: _estimate_json(e) for e in result.estimates},
        "nuisances": {key: first[key] for key in keys} | {"by_record": by_record},
        "noise_rms": result.noise_rms,
        "residual_over_noise": result.residual_over_noise,
        "model": str(result.model),
        "statistics": result.statistics,
        "reasons": result.reasons,
        "hold_out": result.hold_out,
        "covariance_log": np.asarray(result.covariance).tolist(),
        "speeds_m_s": list(result.speeds_m_s),
        "records": [{"name": r.name, "sha256": r.sha256} for r in result.records],
        "notes": result.notes,
        "checked_only": result.checked_only,
        "scene": None,
        "evaluations": result.evaluations,
        "wall_s": result.wall_s,
    }


def _estimate_json(e: Estimate) -> dict[str, Any]:
    return {
        "value": e.value,
        "low": e.low,
        "high": e.high,
        "verdict": str(e.verdict),
        "half_width_percent": e.half_width_percent,
        "start": e.start,
        "half_width_alone_percent": e.alone_percent,
        "prior_pull_sigma": e.prior_pull,
    }


def _nuisance_json(n: Nuisance) -> dict[str, Any]:
    """The fields by their names; JSON calls the discrepancy an error of the model."""
    fields = asdict(n)
    del fields["record"]
    return {key.replace("discrepancy", "model_error"): value for key, value in fields.items()}


def fit_table(result: FitResult) -> FitTable:
    """Return the `[fit]` table of a fitted scene."""
    estimates = result.estimates
    covariance = np.where(np.isfinite(result.covariance), result.covariance, 0.0)
    for i, e in enumerate(estimates):
        if e.verdict is not KeyVerdict.IDENTIFIED:
            covariance[i, :] = covariance[:, i] = 0.0
    return FitTable(
        keys=tuple(e.key for e in estimates),
        values=tuple(e.value for e in estimates),
        low=tuple(OPEN if e.low is None else e.low for e in estimates),  # type: ignore[misc]
        high=tuple(OPEN if e.high is None else e.high for e in estimates),  # type: ignore[misc]
        verdicts=tuple(str(e.verdict) for e in estimates),
        covariance_log=tuple(float(v) for v in covariance.ravel()),
        model=str(result.model),
        residual_over_noise=float(result.residual_over_noise),
        records=tuple(r.name for r in result.records),
        sha256=tuple(r.sha256 for r in result.records),
        speeds_m_s=result.speeds_m_s,
    )


def fitted_scene(result: FitResult, name: str) -> str:
    """Return the fitted scene as TOML, with its `[fit]` table. Raises ValueError of a check."""
    if result.setup is None:
        raise ValueError("a check has no fitted scene")
    scene = result.setup.scene.replaced(name=name, fit=fit_table(result))
    return to_toml(scene)


def write_picture(result: FitResult, path: Path) -> None:
    """Draw the records of a fit to a file. Raises NotWritten."""
    from hertzloop.studies.pages import pictures  # of an extra

    rows = list(zip(result.records, result.nuisances, result.curves, strict=True))
    sheet, axes = pictures.sheet(len(rows), 2, width=10.0, height=2.6)
    for (left, right), (record, nuisance, curve) in zip(axes, rows, strict=True):
        time_us, used = 1e6 * curve["time_s"], curve["used"]
        residual = (curve["measured"] - curve["simulated"]) / nuisance.noise_rms
        left.plot(time_us[used], curve["measured"][used], ".", markersize=3, label="measured")
        left.plot(time_us, curve["simulated"], label="simulated")
        left.set(
            title=record.name, ylabel=f"{record.quantity} ({QUANTITIES[record.quantity].unit})"
        )
        left.legend()
        right.axhspan(-2.0, 2.0, color="#dfe4ec", label="twice the noise")
        right.plot(time_us[used], residual[used], ".", markersize=3, label="residual")
        right.set(ylabel="residual over noise")
        right.legend()
        for ax in (left, right):
            ax.set(xlabel="time after the first touch (us)")
    pictures.save(sheet, path)
