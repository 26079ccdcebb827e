"""A fit as a scene with a `[fit]` table."""

import numpy as np

from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.fit.verdicts import OPEN, KeyVerdict
from hertzloop.scene.tables import FitTable
from hertzloop.scene.toml import to_toml


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
