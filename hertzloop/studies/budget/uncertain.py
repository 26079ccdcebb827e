"""How likely a law meets its goals when scene keys are not known exactly.

A file names a distribution for each key. Cases are drawn by (seed, number), so that a longer run
begins with the cases of a shorter one. The probability has a Wilson interval (E. B. Wilson, J. Am.
Stat. Assoc. 22 (1927) 209); sensitivities are Sobol indices by SALib (A. Saltelli et al., Comput.
Phys. Commun. 181 (2010) 259).
"""

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from hertzloop.analysis.cases import CaseState, Span
from hertzloop.scenes.errors import SceneError, shown
from hertzloop.setup import Setup
from hertzloop.studies.budget.goal import FIGURES, Goal, all_met, worst_excess
from hertzloop.studies.sweeps.design import Axis, Design
from hertzloop.studies.sweeps.evaluate import Pool, Rows, evaluate

_STREAM = 11  # random stream of the draws; noise, jitter, drop-outs and touch phase have others
_FIRST, QUANTILES = 64, (0.05, 0.25, 0.5, 0.75, 0.95)
_NUMBERS: dict[str, tuple[str, ...]] = {
    "normal": ("mean", "standard_deviation"),
    "log_normal": ("median", "sigma"),
    "uniform": ("low", "high"),
    "triangular": ("low", "mode", "high"),
}
_NORMAL = NormalDist()


@dataclass(frozen=True)
class Part:
    """One scene key, or several correlated ones, with a distribution.

    `kind`: normal, log_normal, uniform, triangular, values or correlated; `numbers`: of the
    distribution, in the unit of the key, in the order of the file's documentation (`values`: the
    measured values); `factor`: of correlated keys, the Cholesky factor of the covariance, rows as
    `keys`; `grains`: how far apart the values of each key are, 0 for any number.
    """

    keys: tuple[str, ...]
    kind: str
    numbers: tuple[float, ...]
    factor: tuple[tuple[float, ...], ...] = ()
    grains: tuple[float, ...] = (0.0,)

    def at(self, shares: Sequence[float]) -> dict[str, Any]:
        """Return the values at a point of the unit cube, one number in (0, 1) a key."""
        found = self._correlated(shares) if self.factor else [self._single(shares[0])]
        return {
            key: _on_grain(value, grain)
            for key, value, grain in zip(self.keys, found, self.grains, strict=True)
        }

    def _correlated(self, shares: Sequence[float]) -> list[float]:
        normal = np.array([_NORMAL.inv_cdf(share) for share in shares])
        return [float(x) for x in np.array(self.numbers) + np.array(self.factor) @ normal]

    def _single(self, share: float) -> float:
        one = self.numbers
        if self.kind == "normal":
            return one[0] + one[1] * _NORMAL.inv_cdf(share)
        if self.kind == "log_normal":
            return one[0] * math.exp(one[1] * _NORMAL.inv_cdf(share))
        if self.kind == "uniform":
            return one[0] + share * (one[1] - one[0])
        if self.kind == "triangular":
            low, mode, high = one
            below = (mode - low) / (high - low)
            if share < below:
                return low + math.sqrt(share * (high - low) * (mode - low))
            return high - math.sqrt((1.0 - share) * (high - low) * (high - mode))
        return one[min(int(share * len(one)), len(one) - 1)]


def _on_grain(value: float, grain: float) -> Any:
    if not grain:
        return value
    near = round(value / grain) * grain
    return round(near) if grain == round(grain) else float(f"{near:.12g}")


@dataclass(frozen=True)
class Uncertain:
    """All uncertain keys of a scene."""

    parts: tuple[Part, ...]

    @property
    def keys(self) -> list[str]:
        """The keys, in order."""
        return [key for part in self.parts for key in part.keys]

    def at(self, point: Sequence[float]) -> dict[str, Any]:
        """Return the values at a point of the unit cube, shape (keys,)."""
        found: dict[str, Any] = {}
        place = 0
        for part in self.parts:
            found |= part.at(point[place : place + len(part.keys)])
            place += len(part.keys)
        return found

    def draw(self, seed: int, number: int) -> dict[str, Any]:
        """Return case `number`: a function of the seed and this number alone. Its noise, jitter and
        drop-outs have a seed of their own, unless the file gives `run.seed` a distribution."""
        bits = np.random.Philox(key=[seed, _STREAM], counter=[0, 0, number, 0])
        point = np.random.Generator(bits).random(len(self.keys))
        own = {"run.seed": seed + number}
        return own | self.at([min(max(float(x), 1e-15), 1.0 - 1e-15) for x in point])


def read_uncertain(path: Path, setup: Setup) -> Uncertain:
    """Read distributions from a TOML file. Raises SceneError."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SceneError(f"--uncertain = {path}: cannot be read: {error}") from error
    return uncertain_of(data, setup, f"--uncertain {path}")


def uncertain_of(data: Mapping[str, Any], setup: Setup, name: str = "uncertain") -> Uncertain:
    """Return the uncertain keys that a table describes.

    Args:
        data: By scene key, a table with `distribution` and its numbers; or under "correlated", a
            list of tables with keys, mean and covariance.
        setup: The scene that has the keys.
        name: What the table is called in an error.

    Raises:
        SceneError: a distribution is unknown, lacks a number, or the scene lacks a key.
    """
    parts = []
    for key, given in data.items():
        if key == "correlated":
            parts += [_correlated(each, setup, name) for each in given]
        else:
            parts.append(_part(key, given, setup, name))
    found = Uncertain(tuple(parts))
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


def _part(key: str, given: Any, setup: Setup, name: str) -> Part:
    table = given if isinstance(given, dict) else {}
    kind = table.get("distribution")
    grains = (setup.grain_of(key),)
    if kind == "values":
        values = table.get("values", [])
        numbers = _floats(values if isinstance(values, list) else [], len(values), key, name)
        if not numbers:
            raise SceneError(f"{name}, {key}.values = []: is empty. Give measured values")
        return Part((key,), "values", numbers, (), grains)
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
    return Part((key,), kind, numbers, (), grains)


def _correlated(given: Any, setup: Setup, name: str) -> Part:
    table = given if isinstance(given, dict) else {}
    keys = tuple(map(str, table.get("keys", ())))
    mean = _floats(table.get("mean", []), len(keys), "correlated.mean", name)
    rows = [_floats(row, len(keys), "correlated.covariance", name)
            for row in table.get("covariance", [])]  # fmt: skip
    try:
        matrix = np.array(rows)
        if len(keys) < 2 or len(rows) != len(keys) or not np.allclose(matrix, matrix.T):
            raise np.linalg.LinAlgError
        factor = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise SceneError(
            f"{name}, correlated: needs keys, mean and a symmetric positive definite covariance "
            "with a row and a column a key. Give at least two keys"
        ) from None
    return Part(
        keys, "correlated", mean, tuple(tuple(map(float, row)) for row in factor),
        tuple(setup.grain_of(key) for key in keys),
    )  # fmt: skip


def _floats(values: Any, count: int, key: str, name: str) -> tuple[float, ...]:
    good = isinstance(values, list) and all(
        isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in values
    )
    if not good or len(values) != count:
        raise SceneError(
            f"{name}, {key} = {shown(values)}: must be {count} finite numbers. Correct the list"
        )
    return tuple(float(x) for x in values)


def wilson(met: int, cases: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the Wilson interval of a probability.

    Args:
        met: Number of cases with success.
        cases: Number of all cases, at least 1.
        confidence: Probability with which the interval holds the true one.
    """
    z = _NORMAL.inv_cdf(0.5 + 0.5 * confidence)
    share, weight = met / cases, z * z / cases
    middle = (share + 0.5 * weight) / (1.0 + weight)
    half = z * math.sqrt(share * (1.0 - share) / cases + 0.25 * weight / cases) / (1.0 + weight)
    low = 0.0 if met == 0 else max(0.0, middle - half)
    return low, 1.0 if met == cases else min(1.0, middle + half)


@dataclass(frozen=True)
class DrawnDesign(Design):
    """Cases of a sweep that are drawn from distributions. `listed`: their values, in order."""

    listed: tuple[dict[str, Any], ...] = ()

    def cases(self) -> list[dict[str, Any]]:
        """Return the values of each case."""
        return [dict(case) for case in self.listed]


def drawn_design(setup: Setup, uncertain: Uncertain, count: int) -> DrawnDesign:
    """Return a sweep over so many cases of an uncertain scene. Raises SceneError for a case that no
    scene can have."""
    drawn = tuple(uncertain.draw(setup.seed, number) for number in range(count))
    for case in drawn:
        setup.vary(case)
    axes = tuple(Axis(key, tuple(case[key] for case in drawn)) for key in drawn[0])
    return DrawnDesign(axes, "grid", count, setup.seed, listed=drawn)


@dataclass(frozen=True)
class Probability:
    """How likely the goals are met.

    `value`: share of the cases that meet them; `interval`: Wilson's, at `confidence`; `quantiles`:
    of every figure over the cases that have one, by probability; `worst`: varied keys of the case
    that misses the goals by most, or is nearest to that; `drawn`: of every case, in order.
    """

    value: float
    interval: tuple[float, float]
    confidence: float
    cases: int
    met: int
    unstable: int
    quantiles: dict[str, dict[float, float]]
    worst: dict[str, Any]
    worst_figures: dict[str, float]
    drawn: tuple[dict[str, Any], ...]


def probability(
    pool: Pool,
    setup: Setup,
    goals: Sequence[Goal],
    uncertain: Uncertain,
    span: Span,
    *,
    within: float = 0.05,
    most: int = 4096,
    confidence: float = 0.95,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Probability:
    """Draw cases until the interval of the probability is narrow enough.

    The number of cases doubles from 64 on, so that the rule to stop is applied a few times only.

    Args:
        pool: Runs cases.
        setup: The scene.
        goals: All have to be met.
        uncertain: The distributions.
        span: Figures of the first impact, or of the whole run.
        within: Half the width of the interval that is narrow enough.
        most: Number of cases after which to stop in any event.
        confidence: Of the interval.
        on_progress: Is told the finished share of the work.

    Raises:
        SceneError: a case cannot be run.
    """
    rows: Rows = []
    drawn: list[dict[str, Any]] = []
    wanted = min(_FIRST, most)
    while True:
        new = [uncertain.draw(setup.seed, number) for number in range(len(drawn), wanted)]
        drawn += new
        rows += evaluate(pool, setup, span, new)
        for row in rows:
            if row["state"] == CaseState.NOT_RUN:
                values = ", ".join(f"{key} = {row[key]:.6g}" for key in drawn[0])
                raise SceneError(f"the case with {values} cannot be run: {row['status']}")
        met = sum(all_met(goals, row) for row in rows)
        interval = wilson(met, len(rows), confidence)
        half = 0.5 * (interval[1] - interval[0])
        on_progress(min(1.0, within / half))
        if half <= within or len(rows) >= most:
            break
        wanted = min(2 * len(rows), most)
    worst = max(rows, key=lambda row: worst_excess(goals, row))
    return Probability(
        value=met / len(rows),
        interval=interval,
        confidence=confidence,
        cases=len(rows),
        met=met,
        unstable=sum(row["state"] == CaseState.UNSTABLE for row in rows),
        quantiles={name: _quantiles(rows, name) for name in FIGURES},
        worst={key: worst[key] for key in drawn[0]},
        worst_figures={name: math.nan if worst[name] is None else worst[name]
                       for name in FIGURES},
        drawn=tuple(drawn),
    )  # fmt: skip


def _quantiles(rows: Rows, figure: str) -> dict[float, float]:
    known = [row[figure] for row in rows if row[figure] is not None and row[figure] == row[figure]]
    if not known:
        return dict.fromkeys(QUANTILES, math.nan)
    return {q: float(np.quantile(known, q)) for q in QUANTILES}


@dataclass(frozen=True)
class Sensitivity:
    """Sobol indices of one uncertain part on one figure, each with half its 95 % interval.
    Correlated keys count as one part."""

    keys: tuple[str, ...]
    figure: str
    first: float
    first_half: float
    total: float
    total_half: float


def sobol_indices(
    parts: Sequence[Part], figures: Sequence[str], base: int,
    run: Callable[[list[list[float]]], Sequence[Mapping[str, float]]], seed: int = 1,
) -> list[Sensitivity]:  # fmt: skip
    """Return first-order and total Sobol indices.

    Args:
        parts: The uncertain parts.
        figures: Names of the figures.
        base: Number of base points, a power of 2; base * (parts + 2) points are run.
        run: Returns the figures at points of the unit cube, shape (points, keys).
        seed: Of the points and of the bootstrap that gives the intervals.

    Raises:
        ModuleNotFoundError: SALib is not installed.
        SceneError: a figure is missing at a point.
    """
    from SALib.analyze import sobol
    from SALib.sample import sobol as sampling

    names = [key for part in parts for key in part.keys]
    groups = [str(number) for number, part in enumerate(parts) for _ in part.keys]
    problem: dict[str, Any] = {
        "num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names),
    }  # fmt: skip
    if len(parts) < len(names):
        problem["groups"] = groups
    points = sampling.sample(problem, base, calc_second_order=False, seed=seed)
    inside = np.clip(points, 1e-15, 1.0 - 1e-15)
    rows = run([[float(x) for x in point] for point in inside])
    found = []
    for figure in figures:
        values = np.array([row[figure] for row in rows], dtype=float)
        if not np.isfinite(values).all():
            raise SceneError(
                f"{figure}: is missing in {np.count_nonzero(~np.isfinite(values))} cases, as their "
                "loop is unstable. Narrow the distributions to get Sobol indices"
            )
        if np.ptp(values) == 0.0:
            found += [Sensitivity(part.keys, figure, 0.0, 0.0, 0.0, 0.0) for part in parts]
            continue
        got = sobol.analyze(
            problem, values, calc_second_order=False, seed=seed, print_to_console=False
        )
        for number, part in enumerate(parts):
            numbers = (float(got[name][number]) for name in ("S1", "S1_conf", "ST", "ST_conf"))
            found.append(Sensitivity(part.keys, figure, *numbers))
    return found


def sensitivities(
    pool: Pool, setup: Setup, goals: Sequence[Goal], uncertain: Uncertain, span: Span, base: int
) -> list[Sensitivity]:
    """Return the Sobol indices of the figures of the goals. See `sobol_indices`."""

    def run(points: list[list[float]]) -> Rows:
        rows = evaluate(pool, setup, span, [uncertain.at(point) for point in points])
        return [{name: math.nan if row[name] is None else row[name] for name in FIGURES}
                for row in rows]  # fmt: skip

    names = list(dict.fromkeys(goal.figure for goal in goals))
    return sobol_indices(uncertain.parts, names, base, run, setup.seed)
