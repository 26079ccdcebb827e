"""Speed against accuracy: schemes and solvers on the same modal equations of the same impacts.

Without control and plate damping, so that the energy must be kept; gap at common samples of the
first contact against the default scheme at a far smaller step, which tests hold to DOP853.
CPU times are measured in turn, round after round.
"""

import importlib.util
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import integrator_kernels as ik
from benchmarks.before_after import BeforeOption, draw_impacts
from benchmarks.integrators import (
    Problem,
    Run,
    Solution,
    cvode_run,
    dop853_run,
    kernel_run,
    plant_run,
    problem,
)
from benchmarks.program import OutDirOption, QuickOption, median, start, tracked
from benchmarks.results import Columns, Results, results_in
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.studies.pages import pictures

_REFERENCE_STEP_S = 3.125e-8
_STEPS_S = (4e-6, 2e-6, 1e-6, 5e-7, 2.5e-7, 1.25e-7)
_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
_SCENES = {"aluminium-3mm": 6e-5, "aluminium-20mm": 1.4e-3, "oak-20mm": 2e-3}
_QUICK_SCENES = ("aluminium-3mm", "aluminium-20mm")
_CVODE_TOLERANCES = (1e-4, 1e-6)
_BLOWN = 1e3
_ESTIMATE = "dop853, evaluations"  # what its evaluations cost without the way in from Python
# Competitors of the printed tables.
_COMPETITORS = {
    "the best of SciPy and SUNDIALS": ("dop853", "cvode"),
    "DOP853's evaluations alone, compiled": (_ESTIMATE,),
    "discrete_gradient": ("discrete_gradient",),
}
_ERROR = 1e-3  # of the conclusion


@dataclass(frozen=True)
class Point:
    """One scheme at one setting. `error`: largest of the gap relative to its largest value in
    contact, infinite if the scheme blows up; `energy_drift`: relative to the impact's."""

    scene: str
    scheme: str
    setting: str
    error: float
    energy_drift: float
    cpu_s_per_ms: float  # of simulated time


def draw(path: Path, names: Sequence[str], points: Sequence[Point]) -> None:
    """Error of the gap against CPU time; a column a scene."""
    picture, axes = pictures.sheet(1, len(names), 4.6 * len(names) + 2.0, 3.9)
    for axis, name in zip(axes[0], names, strict=True):
        for i, scheme in enumerate(dict.fromkeys(p.scheme for p in points)):
            mine = [p for p in points if (p.scene, p.scheme) == (name, scheme)]
            cpu, errors = [p.cpu_s_per_ms for p in mine], [p.error for p in mine]
            axis.loglog(cpu, errors, label=scheme, **pictures.look(i, True))
        axis.set(title=name, xlabel="CPU time (s per simulated ms)", ylabel="error of the gap")
        axis.set_ylim(1e-9, 1.0)
    axes[0, -1].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    pictures.save(picture, path)


def _cases(what: Problem) -> dict[tuple[str, str], Run]:
    """Scheme and setting to a run."""
    found: dict[tuple[str, str], Run] = {}
    for step_s in _STEPS_S:
        setting = f"{step_s * 1e6:g} us"
        found["modal", setting] = plant_run(ModalPlant, what, step_s)
        found["discrete_gradient", setting] = plant_run(DiscreteGradientPlant, what, step_s)
        found["verlet", setting] = kernel_run(ik.verlet, what, step_s)
        found["rk4", setting] = kernel_run(ik.rk4, what, step_s)
    for tolerance in _TOLERANCES:
        found["dop853", f"rtol {tolerance:g}"] = dop853_run(what, tolerance)
    if importlib.util.find_spec("sksundae"):
        for tolerance in _CVODE_TOLERANCES:
            found["cvode", f"rtol {tolerance:g}"] = cvode_run(what, tolerance)
    return found


def measure(name: str, duration_s: float, rounds: int) -> list[Point]:
    """All points of a scene."""
    what = problem(name, duration_s)
    reference = plant_run(ModalPlant, what, _REFERENCE_STEP_S)().gaps
    end, deepest = int(np.flatnonzero(reference <= 0.0)[-1]) + 1, -float(reference.min())
    per_ms = 1e3 * what.duration_s
    runs = _cases(what)
    solutions = {key: run() for key, run in runs.items()}  # compiles, too
    cpu_s = {key: math.inf for key in runs}
    for _ in tracked(f"{name}, rounds", range(rounds)):
        for key, run in runs.items():
            cpu_s[key] = min(cpu_s[key], run().cpu_s)

    def point(key: tuple[str, str], found: Solution) -> Point:
        error = float(np.abs(found.gaps - reference)[:end].max()) / deepest
        error = error if error < _BLOWN else math.inf
        return Point(name, *key, error, found.energy_drift, cpu_s[key] / per_ms)

    points = [point(*item) for item in solutions.items()]
    slope_s = slope_cost_s(what)
    for p in [p for p in points if p.scheme == "dop853"]:
        cost = solutions[p.scheme, p.setting].evaluations * slope_s / per_ms
        points.append(replace(p, scheme=_ESTIMATE, cpu_s_per_ms=cost))
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


def run(results: Results, quick: bool) -> list[Point]:
    """Measure, and write the points and the picture."""
    names = list(_QUICK_SCENES if quick else _SCENES)
    points = [p for name in names for p in measure(name, _SCENES[name], 2 if quick else 5)]
    results.write("speed_accuracy", points)
    draw(results.path("speed_accuracy.png"), names, points)
    return points


def cost_at(points: list[Point], scene: str, schemes: Sequence[str], error: float) -> float:
    """Least CPU time (s per ms) of the settings of some schemes that meet an error; NaN if none
    does."""
    met = [
        p.cpu_s_per_ms
        for p in points
        if p.scene == scene and p.scheme in schemes and 0.0 < p.error <= error
    ]
    return min(met, default=math.nan)


def ratios(
    points: list[Point], schemes: Sequence[str]
) -> Iterator[tuple[str, float, float, float]]:
    """Scene, error, and the cost of the default scheme and of the cheapest of some schemes."""
    for scene in dict.fromkeys(p.scene for p in points):
        for error in (1e-3, 1e-4, 1e-6):
            modal = cost_at(points, scene, ("modal",), error)
            yield scene, error, modal, cost_at(points, scene, schemes, error)


def conclusion(points: list[Point]) -> str:
    """How fast the default scheme is against the fastest general solver, in one sentence."""
    solvers = _COMPETITORS["the best of SciPy and SUNDIALS"]
    found = [other / modal for _, error, modal, other in ratios(points, solvers) if error == _ERROR]
    times = float(f"{median(found):.2g}")
    return (
        f"At an error of {_ERROR:g} the default scheme is {times:g} times as fast as the "
        f"fastest general solver, median of {len(found)} scenes."
    )


def main(
    folder: OutDirOption = None, quick: QuickOption = False, before: BeforeOption = None
) -> None:
    """Compare error and CPU time of schemes and solvers on the same modal equations.

    Example: python -m benchmarks.speed_accuracy --quick
    """
    with results_in(folder, "speed_accuracy", "modal") as results:
        points = run(results, quick)
        if before:
            draw_impacts(results.path("speed_accuracy-before.png"), before, results.folder)
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
