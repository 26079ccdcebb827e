"""A fit as JSON, as a scene with a `[fit]` table, and as a picture."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.fitting.fit.results import OPEN, Estimate, FitResult, KeyVerdict, Nuisance
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.scene.tables import FitTable
from hertzloop.scene.toml import to_toml


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
