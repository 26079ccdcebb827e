"""Read the distributions of uncertain scene keys from a TOML file, or from a scene."""

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from hertzloop.common.missing_files import told_if_unreadable
from hertzloop.common.text_files import text_of
from hertzloop.scene.errors import SceneError, shown
from hertzloop.scene.setup import Setup
from hertzloop.scene.tables import FitTable
from hertzloop.studies.cases.uncertain import UncertainInput, UncertainInputs

_NUMBERS: dict[str, tuple[str, ...]] = {
    "normal": ("mean", "standard_deviation"),
    "log_normal": ("median", "sigma"),
    "uniform": ("low", "high"),
    "triangular": ("low", "mode", "high"),
}
_IDENTIFIED, _SAME = "identified", 1e-9


def read_uncertain(path: Path, setup: Setup) -> UncertainInputs:
    """Read distributions from a TOML file.

    Args:
        path: a file of distributions, or a scene: its tables `[uncertain]` and `[fit]` are read.
        setup: the scene that has the keys.

    Raises:
        SceneError: the file cannot be read, or a distribution does not fit the scene.
    """
    name = f"--uncertain {path}"
    remedy = "Give the path of a TOML file with distributions."
    with told_if_unreadable(path, f"--uncertain = {path}", remedy, SceneError):
        data = tomllib.loads(text_of(path.read_bytes()))
    try:
        fit = FitTable.model_validate(data["fit"]) if "fit" in data else None
    except ValidationError as error:
        wrong = ".".join(map(str, ("fit", *error.errors()[0]["loc"])))
        raise SceneError(
            f"{name}, {wrong}: {error.errors()[0]['msg']}. Write the scene again with "
            "`hertzloop fit`."
        ) from error
    if fit is None and "uncertain" not in data:
        return uncertain_of(data, setup, name)
    fitted = () if fit is None else (_fitted(fit, setup, name),)
    return _checked(fitted + _parts(data.get("uncertain", {}), setup, name), setup, name)


def uncertain_of(data: Mapping[str, Any], setup: Setup, name: str = "uncertain") -> UncertainInputs:
    """Return the uncertain keys that a table describes.

    Args:
        data: By scene key, a table with `distribution` and its numbers.
        setup: The scene that has the keys.
        name: What the table is called in an error.

    Raises:
        SceneError: a distribution is unknown, lacks a number, or the scene lacks a key.
    """
    return _checked(_parts(data, setup, name), setup, name)


def _parts(data: Any, setup: Setup, name: str) -> tuple[UncertainInput, ...]:
    if not isinstance(data, Mapping):
        raise SceneError(f"{name}, uncertain = {shown(data)}: must be a table of scene keys")
    return tuple(_part(key, given, setup, name) for key, given in data.items())


def _checked(parts: tuple[UncertainInput, ...], setup: Setup, name: str) -> UncertainInputs:
    found = UncertainInputs(parts)
    if not parts:
        raise SceneError(f"{name}: has no key. Give a distribution for at least one scene key")
    for key in found.keys:
        if found.keys.count(key) > 1:
            raise SceneError(f"{name}, {key}: has two distributions. Keep one of them")
    for share in (0.5, 0.05, 0.95):
        try:
            setup.vary(found.at([share] * len(found.keys)))
        except SceneError as error:
            raise SceneError(f"{name}, at the {share:g} quantiles: {error}") from error
    return found


def _part(key: str, given: Any, setup: Setup, name: str) -> UncertainInput:
    table = given if isinstance(given, dict) else {}
    kind = table.get("distribution")
    resolutions = (setup.resolution_of(key),)
    if kind == "values":
        values = table.get("values")
        if not isinstance(values, list) or not values:
            raise SceneError(
                f"{name}, {key}.values = {shown(values)}: must be a list of measured values. "
                "Give one"
            )
        numbers = _floats(values, len(values), key, name)
        return UncertainInput((key,), "values", numbers, (), resolutions)
    if kind not in _NUMBERS:
        raise SceneError(
            f"{name}, {key}.distribution = {shown(kind)}: is unknown. Choose one of "
            f"{', '.join([*_NUMBERS, 'values'])}"
        )
    wanted = _NUMBERS[kind]
    if set(table) != {"distribution", *wanted}:
        raise SceneError(
            f"{name}, {key}: has {', '.join(sorted(set(table) - {'distribution'})) or 'nothing'}, "
            f"but the distribution {kind} needs {', '.join(wanted)}. Give these"
        )
    numbers = _floats([table[part] for part in wanted], len(wanted), key, name)
    ordered = sorted(numbers) == list(numbers) and numbers[0] < numbers[-1]
    if kind in ("uniform", "triangular") and not ordered:
        raise SceneError(f"{name}, {key}: {', '.join(wanted)} must increase. Put them in order")
    if kind in ("normal", "log_normal") and not numbers[1] > 0.0:
        raise SceneError(f"{name}, {key}.{wanted[1]} = {numbers[1]:g}: must be above 0. Change it")
    return UncertainInput((key,), kind, numbers, (), resolutions)


def _fitted(table: FitTable, setup: Setup, name: str) -> UncertainInput:
    """The keys that a fit identified, with the covariance of their logarithms."""
    n = len(table.keys)
    if not len(table.values) == len(table.verdicts) == n or len(table.covariance_log) != n * n:
        raise SceneError(
            f"{name}, fit.covariance_log: must have {n} x {n} values, for the keys of fit.keys. "
            "Write the scene again with `hertzloop fit`."
        )
    variance = np.array(table.covariance_log).reshape(n, n).diagonal()
    # A key in whole steps, such as a latency, has no variance. It keeps its value.
    known = [
        i
        for i, verdict in enumerate(table.verdicts)
        if verdict == _IDENTIFIED and variance[i] > 0.0
    ]
    if not known:
        raise SceneError(
            f"{name}: the fit identified no key that can be drawn. Fit a record that tells more."
        )
    for i in known:
        now = setup.value_of(table.keys[i])
        if not isinstance(now, float | int) or abs(now / table.values[i] - 1.0) > _SAME:
            raise SceneError(
                f"{table.keys[i]} = {shown(now)}: the fit found {table.values[i]:g}, so its "
                "uncertainty does not hold. Leave the key as it was fitted, or fit again."
            )
    covariance = np.array(table.covariance_log).reshape(n, n)[np.ix_(known, known)]
    sizes, axes = np.linalg.eigh(covariance)
    factor = axes * np.sqrt(np.maximum(sizes, 0.0))
    return UncertainInput(
        tuple(table.keys[i] for i in known),
        "fitted",
        tuple(table.values[i] for i in known),
        tuple(tuple(map(float, row)) for row in factor),
        (0.0,) * len(known),
    )


def _floats(values: Any, count: int, key: str, name: str) -> tuple[float, ...]:
    good = isinstance(values, list) and all(
        isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in values
    )
    if not good or len(values) != count:
        raise SceneError(
            f"{name}, {key} = {shown(values)}: must be {count} finite numbers. Correct the list"
        )
    return tuple(float(x) for x in values)
