"""Speed against accuracy: every scheme on the same modal equations of the same impacts.

Without control and plate damping, so that the energy must be kept; gap at common samples of the
first contact against the default scheme at a far smaller step, which tests hold to DOP853.
CPU times are measured in turn, round after round.
"""

import importlib.util
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import integrator_kernels as ik
from benchmarks.integrators import (
    Problem,
    Run,
    TooSlowError,
    collocation_run,
    convolution_run,
    cvode_run,
    dop853_run,
    kernel_run,
    plant_run,
    problem,
    quadratised_run,
    scipy_run,
    thesis_run,
)
from benchmarks.program import OutDirOption, QuickOption, median, start, tracked
from benchmarks.results import Columns, Results, results_in
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.studies.pages import pictures

# The default scheme is in both rows, as series 0.
_FAMILIES = {
    "textbook and second-order schemes": (
        "modal",
        "discrete_gradient",
        "quadratised",
        "convolution",
        "verlet",
        "rk4",
        "newmark",
        "hht",
    ),
    "high-order and adaptive schemes": (
        "modal",
        "collocation-s1",
        "collocation-s2",
        "collocation-s3",
        "dop853 compiled",
        "dop853",
        "cvode",
        "lsoda",
    ),
}


def draw(path: Path, names: Sequence[str], points: Sequence[Any]) -> None:
    """Error of the gap against CPU time; a row a family, a column a scene. Schemes that
    were left out are below, with the reason."""
    metric, axes = pictures.sheet(len(_FAMILIES), len(names), 4.6 * len(names) + 2.0, 3.9)
    for row, (family, schemes) in zip(axes, _FAMILIES.items(), strict=True):
        for axis, name in zip(row, names, strict=True):
            for i, scheme in enumerate(schemes):
                mine = [p for p in points if (p.scene, p.scheme, p.status) == (name, scheme, "ok")]
                axis.loglog(
                    [p.cpu_s_per_ms for p in mine],
                    [p.error for p in mine],
                    label=scheme,
                    **pictures.look(i, True),
                )
            axis.set(title=f"{name}: {family}", xlabel="CPU time (s per simulated ms)")
            axis.set_ylabel("error of the gap")
            axis.set_ylim(1e-9, 1.0)
            axis.title.set_fontsize(9)
        lines, labels = row[0].get_legend_handles_labels()
        row[-1].legend(lines, labels, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    left_out = [p for p in points if math.isnan(p.cpu_s_per_ms)]
    words = [f"{p.scene}, {p.scheme}: {p.status}" for p in left_out]
    if "radau" in {p.scheme for p in points if p.status == "ok"}:
        words.append("radau: not drawn where it ends, beside lsoda (see the CSV)")
    metric.supxlabel("\n".join(words), fontsize=7)
    pictures.save(metric, path)


_REFERENCE_STEP_S = 3.125e-8
_STEPS_S = (4e-6, 2e-6, 1e-6, 5e-7, 2.5e-7, 1.25e-7)
_THESIS_STEPS_S = (4e-6, 2e-6, 1e-6)
_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
_SCENES = {"aluminium-3mm": 6e-5, "aluminium-20mm": 1.4e-3, "oak-20mm": 2e-3}
_QUICK_SCENES = ("aluminium-3mm", "aluminium-20mm")
_CVODE_TOLERANCES = (1e-4, 1e-6)
_IMPLICIT = ("Radau", "LSODA")  # once each: they take seconds
_IMPLICIT_TOLERANCES = (1e-3, 1e-4, 1e-6)
_LIMIT_S, _QUICK_LIMIT_S = 8.0, 1.0
_BLOWN = 1e3
_THESIS = "another model: the published equations taken literally (see weaknesses)"


@dataclass(frozen=True)
class Point:
    """One scheme at one setting. `error`: largest of the gap relative to its largest value in
    contact; `energy_drift`: relative to the impact's; CPU time in s per simulated ms, nan if it was
    left out."""

    scene: str
    scheme: str
    setting: str
    error: float
    energy_drift: float
    cpu_s_per_ms: float
    status: str


def _cases(what: Problem) -> dict[tuple[str, str], Run]:
    """Scheme and setting to a run."""
    found: dict[tuple[str, str], Run] = {}
    for step_s in _STEPS_S:
        setting = f"{step_s * 1e6:g} us"
        found["modal", setting] = plant_run(CollocationPlant, what, step_s)
        found["discrete_gradient", setting] = plant_run(DiscreteGradientPlant, what, step_s)
        found["quadratised", setting] = quadratised_run(what, step_s)
        found["convolution", setting] = convolution_run(what, step_s)
        found["verlet", setting] = kernel_run(ik.verlet, what, step_s)
        found["rk4", setting] = kernel_run(ik.rk4, what, step_s)
        found["newmark", setting] = kernel_run(ik.alpha_method, what, step_s, 0.0)
        found["hht", setting] = kernel_run(ik.alpha_method, what, step_s, -0.1)
        for stages in (1, 2, 3):
            run = collocation_run(what, step_s, stages)
            found[f"collocation-s{stages}", setting] = run
        if step_s in _THESIS_STEPS_S:
            found["thesis2008", setting] = thesis_run(what, step_s)
    for tolerance in _TOLERANCES:
        found["dop853 compiled", f"rtol {tolerance:g}"] = dop853_run(what, tolerance)
    for tolerance in _CVODE_TOLERANCES:
        cvode = cvode_run(what, tolerance)
        if cvode is not None:
            found["cvode", f"rtol {tolerance:g}"] = cvode
    return found


def measure(name: str, duration_s: float, rounds: int, limit_s: float) -> list[Point]:
    """All points of a scene; implicit solvers get `limit_s` of CPU time a run."""
    what = problem(name, duration_s)
    reference = plant_run(CollocationPlant, what, _REFERENCE_STEP_S)()[0]
    end, deepest = int(np.flatnonzero(reference <= 0.0)[-1]) + 1, -float(reference.min())
    per_ms = 1e3 * what.duration_s

    def point(scheme: str, setting: str, gaps: np.ndarray, drift: float, cpu_s: float) -> Point:
        error = float(np.abs(gaps - reference)[:end].max()) / deepest
        status = "ok" if error < _BLOWN else "failed: blows up"
        status = _THESIS if scheme in SCHEMES and not SCHEMES[scheme].converges else status
        error = error if np.isfinite(error) else math.inf
        return Point(name, scheme, setting, error, drift, cpu_s / per_ms, status)

    runs = _cases(what)
    counts: dict[str, list[int]] = {}
    for tolerance in _TOLERANCES:
        setting = f"rtol {tolerance:g}"
        counts[setting] = [0]
        runs["dop853", setting] = scipy_run("DOP853", what, tolerance, counts[setting])
    results = {key: run()[:2] for key, run in runs.items()}  # compiles, too
    cpu = {key: math.inf for key in runs}
    for _ in tracked(f"{name}, rounds", range(rounds)):
        for key, run in runs.items():
            cpu[key] = min(cpu[key], run()[2])
    points = [point(*key, *found, cpu[key]) for key, found in results.items()]
    slope_s = slope_cost_s(what)
    status = "estimate: evaluations times one compiled right-hand side"
    for p in [p for p in points if p.scheme == "dop853"]:
        cost = counts[p.setting][0] * slope_s / per_ms
        points.append(
            Point(name, "dop853 estimate", p.setting, p.error, p.energy_drift, cost, status)
        )
    for method in _IMPLICIT:
        for tolerance in _IMPLICIT_TOLERANCES:
            setting = f"rtol {tolerance:g}"
            try:
                found = scipy_run(method, what, tolerance, [0], limit_s)()
                points.append(point(method.lower(), setting, *found))
            except TooSlowError as error:
                points.append(_left_out(name, method.lower(), setting, str(error)))
                break
    return points


def slope_cost_s(what: Problem) -> float:
    """CPU time of one compiled right-hand side, without the way into it from Python."""
    state = what.start()
    ik.many_slopes(state, *what.arguments, 10)
    best = math.inf
    for _ in range(5):
        started = time.process_time()
        ik.many_slopes(state, *what.arguments, 4000)
        best = min(best, (time.process_time() - started) / 4000)
    return best


def _left_out(scene: str, scheme: str, setting: str, reason: str) -> Point:
    return Point(scene, scheme, setting, math.nan, math.nan, math.nan, f"omitted: {reason}")


def run(results: Results, quick: bool) -> list[Point]:
    """Measure, and write the points and the picture."""
    names = list(_QUICK_SCENES if quick else _SCENES)
    rounds, limit_s = (2, _QUICK_LIMIT_S) if quick else (5, _LIMIT_S)
    points = [p for name in names for p in measure(name, _SCENES[name], rounds, limit_s)]
    if importlib.util.find_spec("sksundae") is None:
        reason = "scikit-sundae is not installed (pip install -e '.[dev]')"
        points += [_left_out(name, "cvode", "", reason) for name in names]
    results.write("speed_accuracy", points)
    draw(results.path("speed_accuracy.png"), names, points)
    return points


def cost_at(points: list[Point], scene: str, scheme: str, error: float) -> float:
    """Least CPU time (s per ms) of a scheme's settings that meet an error; NaN if none does."""
    met = [
        p.cpu_s_per_ms
        for p in points
        if (p.scene, p.scheme) == (scene, scheme) and 0.0 < p.error <= error
    ]
    return min(met, default=math.nan)


# Competitors of the printed tables: the best of the installed solvers, the compiled DOP853, ...
_COMPETITORS = {
    "the best of SciPy and SUNDIALS": ("dop853", "cvode", "radau", "lsoda"),
    "compiled DOP853": ("dop853 compiled",),
    "DOP853's evaluations alone (compiled, an estimate)": ("dop853 estimate",),
    "discrete_gradient": ("discrete_gradient",),
    "convolution": ("convolution",),
    "collocation of order 6": ("collocation-s3",),
}


def ratios(
    points: list[Point], schemes: Sequence[str]
) -> Iterator[tuple[str, float, float, float]]:
    """Scene, error, and the cost of the default scheme and of the cheapest of some schemes."""
    for scene in dict.fromkeys(p.scene for p in points):
        for error in (1e-3, 1e-4, 1e-6):
            costs = [cost_at(points, scene, scheme, error) for scheme in schemes]
            other = min((c for c in costs if not math.isnan(c)), default=math.nan)
            yield scene, error, cost_at(points, scene, "modal", error), other


_ERROR = 1e-3  # of the conclusion
_GENERAL = ("dop853 compiled", "dop853", "cvode", "radau", "lsoda")  # solvers of any equations


def conclusion(points: list[Point]) -> str:
    """How fast the default scheme is against the fastest general solver, and against the fastest
    of all other schemes, in one sentence.

    A scheme counts where it solves the same equations to an error of 1e-3 or better.
    """
    others = sorted({p.scheme for p in points if p.status == "ok"} - {"modal"})
    general, general_names = _against(points, [s for s in others if s in _GENERAL])
    fastest, fastest_names = _against(points, others)
    return (
        f"At an error of {_ERROR:g} the default scheme is {median(general):.2g} times as fast as "
        f"the fastest general solver ({general_names}), and {median(fastest):.2g} times as fast as "
        f"the fastest of all other schemes ({fastest_names}), medians of {len(fastest)} scenes."
    )


def _against(points: list[Point], others: list[str]) -> tuple[list[float], str]:
    """Cost of the fastest of `others` over that of the default scheme, one number a scene, and the
    names of the fastest ones."""
    converged = [p for p in points if p.status == "ok"]
    ratios: list[float] = []
    best: set[str] = set()
    for scene in dict.fromkeys(p.scene for p in points):
        costs = {scheme: cost_at(converged, scene, scheme, _ERROR) for scheme in others}
        known = {scheme: cost for scheme, cost in costs.items() if not math.isnan(cost)}
        if known:
            fastest = min(known, key=known.__getitem__)
            best.add(fastest)
            ratios.append(known[fastest] / cost_at(converged, scene, "modal", _ERROR))
    return ratios, ", ".join(sorted(best)) or "none"


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Compare error and CPU time of every scheme on the same modal equations.

    Example: python -m benchmarks.speed_accuracy --quick
    """
    with results_in(folder, "speed_accuracy", "modal") as results:
        points = run(results, quick)
        columns: Columns = {
            "scene": "{[0]}",
            "error": "{[1]:g}",
            "modal (s/ms)": "{[2]:.2e}",
            "competitor (s/ms)": "{[3]:.2e}",
            "times faster": lambda row: f"{row[3] / row[2]:.3g}",
        }
        for competitor, schemes in _COMPETITORS.items():
            results.table(f"modal against {competitor}", columns, ratios(points, schemes), text=0)
        results.conclude(conclusion(points))


if __name__ == "__main__":
    start("benchmarks.speed_accuracy")
