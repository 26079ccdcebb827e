"""Draws from the covariance of a fitted scene, for sweeps."""

import numpy as np

from hertzloop.setup import Setup
from hertzloop.studies.fit.fit import FitError, value_of

_KNOWN = "identified"
_SAME = 1e-9


def draws(setup: Setup, count: int, seed: int) -> tuple[tuple[str, ...], list[tuple[float, ...]]]:
    """Draw values of the fitted keys of a scene.

    Args:
        setup: a scene with a `[fit]` table.
        count: how many draws.
        seed: of the draws.

    Returns:
        The keys, and the values of each draw in their order. Keys that were not identified keep
        the value of the scene and are not drawn.

    Raises:
        FitError: the scene has no fitted key, or one of its values was changed since the fit.
    """
    table = setup.scene.fit
    if table is None:
        raise FitError(
            f"--uncertain {count}: {setup.name} has no [fit] table. Give a scene that `hertzloop "
            "fit` wrote."
        )
    if count < 1:
        raise FitError(f"--uncertain = {count}: must be 1 or more.")
    n = len(table.keys)
    if not len(table.values) == len(table.verdicts) == n or len(table.covariance_log) != n * n:
        raise FitError(
            f"fit.covariance_log: must have {n} x {n} values, for the keys of fit.keys. Write the "
            "scene again with `hertzloop fit`."
        )
    known = [i for i, verdict in enumerate(table.verdicts) if verdict == _KNOWN]
    if not known:
        raise FitError(
            f"--uncertain {count}: no key of {setup.name} is identified. Fit a record that tells "
            "more."
        )
    for i in known:
        now = value_of(setup, table.keys[i])
        if abs(now / table.values[i] - 1.0) > _SAME:
            raise FitError(
                f"{table.keys[i]} = {now:g}: the fit found {table.values[i]:g}, so its uncertainty "
                "does not hold. Leave the key as it was fitted, or fit again."
            )
    covariance = np.array(table.covariance_log).reshape(n, n)[np.ix_(known, known)]
    logs = np.random.default_rng(seed).multivariate_normal(
        np.log([table.values[i] for i in known]), covariance, size=count, method="eigh"
    )
    return tuple(table.keys[i] for i in known), [tuple(map(float, row)) for row in np.exp(logs)]
