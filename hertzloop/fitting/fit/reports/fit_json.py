"""A fit as JSON."""

from dataclasses import asdict
from typing import Any

import numpy as np

from hertzloop.fitting.fit.results import Estimate, FitResult, Nuisance


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
