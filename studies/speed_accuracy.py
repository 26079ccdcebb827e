"""Speed against accuracy: every scheme on the same modal equations of the same impacts.

Without control and plate damping, so that the energy must be kept; gap at common samples of the
first contact against the default scheme at a far smaller step, which tests hold to DOP853.
CPU times are measured in turn, round after round.
"""

import importlib.util
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from hertzloop import parts
from hertzloop.scene import load
from plant.collocation import CollocationPlant
from plant.plant import Plant, PlantSpec
from studies import integrator_kernels as ik
from studies import kernels as k
from studies import pictures
from studies.tabular import write_records

_SAMPLE_S = 4e-6
_REFERENCE_STEP_S = 3.125e-8
_STEPS_S = (4e-6, 2e-6, 1e-6, 5e-7, 2.5e-7, 1.25e-7)
_TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8)
_SCENES = {"aluminium-3mm": 6e-5, "aluminium-20mm": 1.4e-3, "oak-20mm": 2e-3}
_QUICK_SCENES = ("aluminium-3mm", "aluminium-20mm")
_BLOWN = 1e3


@dataclass(frozen=True)
class Point:
    """One scheme at one setting. `error`: largest of the gap relative to its largest value in
    contact; `energy_drift`: relative to the impact's; CPU time in s per simulated ms."""

    scene: str
    scheme: str
    setting: str
    error: float
    energy_drift: float
    cpu_s_per_ms: float
    status: str


@dataclass
class Problem:
    """Modal equations of one scene: arrays (modes,), duration a multiple of the samples."""

    name: str
    spec: PlantSpec
    duration_s: float
    omega2: np.ndarray
    drive: np.ndarray

    @property
    def samples(self) -> int:
        """Number of samples of the gap."""
        return round(self.duration_s / _SAMPLE_S)

    @property
    def arguments(self) -> tuple[Any, ...]:
        """What the integrators' kernels take after the state."""
        spec = self.spec
        return self.omega2, self.drive, spec.contact.stiffness, spec.sphere.mass_kg

    def start(self) -> np.ndarray:
        """State at the first touch."""
        state = np.zeros(2 * len(self.omega2) + 2)
        state[-1] = -self.spec.sphere.impact_speed_m_s
        return state

    def drift(self, state: np.ndarray) -> float:
        """Relative change of the energy since the start."""
        begin = float(ik.energy(self.start(), *self.arguments))
        return float(ik.energy(state, *self.arguments)) / begin - 1.0


Run = Callable[[], tuple[np.ndarray, float, float]]  # gaps, energy drift, CPU time (s)


def problem(name: str, duration_s: float) -> Problem:
    """A scene with the modes that an accuracy of 1e-3 asks for, without damping."""
    spec = parts.plant_spec(load(name, ["contact.damping=none", "plate.loss_factor=0.0"]))
    spec = replace(spec, residual_flexibility=False, lead_in_s=0.0)
    modes = CollocationPlant(spec).modes
    drive = spec.plate.modal_scale_per_kg * modes.contact**2
    duration_s = math.ceil(duration_s / _SAMPLE_S) * _SAMPLE_S
    return Problem(name, spec, duration_s, modes.omega**2, drive)


def _plant_run(make: type[Plant], what: Problem, step_s: float) -> Run:
    plant = make(replace(what.spec, step_s=step_s))
    kept = [array.copy() for array in plant.state]
    every = round(_SAMPLE_S / step_s)
    gaps = np.empty(what.samples)

    def run() -> tuple[np.ndarray, float, float]:
        for array, value in zip(plant.state, kept, strict=True):
            array[:] = value
        started = time.process_time()
        k.plant_gaps(plant.model, plant.state, every, gaps)
        cpu_s = time.process_time() - started
        return gaps.copy(), float(plant.close_books().energy_residual), cpu_s

    return run


def _kernel_run(kernel: Callable[..., None], what: Problem, step_s: float, *more: float) -> Run:
    every = round(_SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        state, gaps = what.start(), np.empty(what.samples)
        started = time.process_time()
        kernel(state, *what.arguments, step_s, every * what.samples, every, gaps, *more)
        return gaps, what.drift(state), time.process_time() - started

    return run


def _scipy_run(method: Any, what: Problem, tolerance: float, count: list[int]) -> Run:
    t = _SAMPLE_S * np.arange(1, what.samples + 1)
    modes = len(what.omega2)

    def run() -> tuple[np.ndarray, float, float]:
        slope: Any = partial(_slope, arguments=what.arguments)
        started = time.process_time()
        solved = solve_ivp(
            slope, (0.0, float(t[-1])), what.start(), method=method, t_eval=t,
            rtol=tolerance, atol=tolerance * 1e-6,
        )  # fmt: skip
        cpu_s = time.process_time() - started
        count[0] = solved.nfev
        plate = solved.y[:modes].sum(axis=0)
        drift = what.drift(np.ascontiguousarray(solved.y[:, -1]))
        return solved.y[2 * modes] - plate, drift, cpu_s

    return run


def _cvode_run(what: Problem, tolerance: float) -> Run | None:
    """SUNDIALS CVODE, Adams with a matrix-free solver; None where scikit-sundae is missing."""
    try:
        from sksundae.cvode import CVODE
    except ImportError:
        return None
    t = _SAMPLE_S * np.arange(what.samples + 1)
    modes = len(what.omega2)

    def slope(time_s: float, y: np.ndarray, out: np.ndarray) -> None:
        out[:] = ik.slope(time_s, y, *what.arguments)

    def run() -> tuple[np.ndarray, float, float]:
        solver = CVODE(
            slope, method="Adams", linsolver="gmres", rtol=tolerance, atol=1e-6 * tolerance,
            max_num_steps=100_000,
        )  # fmt: skip
        started = time.process_time()
        y = solver.solve(t, what.start()).y[1:]
        cpu_s = time.process_time() - started
        drift = what.drift(np.ascontiguousarray(y[-1]))
        return y[:, 2 * modes] - y[:, :modes].sum(axis=1), drift, cpu_s

    return run


def _slope(t: float, y: np.ndarray, arguments: tuple[Any, ...]) -> np.ndarray:
    return np.asarray(ik.slope(t, y, *arguments))


def _slope_cost_s(what: Problem) -> float:
    """CPU time of one compiled right-hand side, without the way into it from Python."""
    state = what.start()
    k.many_slopes(state, *what.arguments, 10)
    best = math.inf
    for _ in range(5):
        started = time.process_time()
        k.many_slopes(state, *what.arguments, 4000)
        best = min(best, (time.process_time() - started) / 4000)
    return best


def _cases(what: Problem) -> dict[tuple[str, str], Run]:
    """Scheme and setting to a run."""
    found: dict[tuple[str, str], Run] = {}
    for step_s in _STEPS_S:
        setting = f"{step_s * 1e6:g} us"
        found["modal", setting] = _plant_run(CollocationPlant, what, step_s)
        found["discrete_gradient", setting] = _plant_run(Plant, what, step_s)
        found["verlet", setting] = _kernel_run(ik.verlet, what, step_s)
        found["rk4", setting] = _kernel_run(ik.rk4, what, step_s)
        found["newmark", setting] = _kernel_run(ik.alpha_method, what, step_s, 0.0)
        found["hht", setting] = _kernel_run(ik.alpha_method, what, step_s, -0.1)
    return found


def measure(name: str, duration_s: float, rounds: int) -> list[Point]:
    """All points of a scene."""
    what = problem(name, duration_s)
    reference = _plant_run(CollocationPlant, what, _REFERENCE_STEP_S)()[0]
    touching = np.flatnonzero(reference <= 0.0)
    end, deepest = int(touching[-1]) + 1, -float(reference.min())
    counts: dict[tuple[str, str], list[int]] = {}
    cases = _cases(what)
    for tolerance in _TOLERANCES:
        key = ("dop853", f"rtol {tolerance:g}")
        counts[key] = [0]
        cases[key] = _scipy_run("DOP853", what, tolerance, counts[key])
    for tolerance in _TOLERANCES[1:3]:
        cvode = _cvode_run(what, tolerance)
        if cvode is not None:
            cases["cvode", f"rtol {tolerance:g}"] = cvode
    results = {key: run()[:2] for key, run in cases.items()}  # compiles, too
    cpu = {key: math.inf for key in cases}
    for _ in range(rounds):
        for key, run in cases.items():
            cpu[key] = min(cpu[key], run()[2])
    per_ms = 1e3 * what.duration_s
    points = []
    for (scheme, setting), (gaps, drift) in results.items():
        error = float(np.abs(gaps - reference)[:end].max()) / deepest
        status = "ok" if error < _BLOWN else "failed: blows up"
        error = error if np.isfinite(error) else math.inf
        cost = cpu[scheme, setting] / per_ms
        points.append(Point(name, scheme, setting, error, drift, cost, status))
        if scheme == "dop853":
            status = "estimate: evaluations times one compiled right-hand side"
            cost = counts[scheme, setting][0] * _slope_cost_s(what) / per_ms
            points.append(Point(name, "dop853 compiled", setting, error, drift, cost, status))
    return points


def _omitted(names: list[str]) -> list[Point]:
    """Schemes that are not on the chart, with the reason."""
    reasons = {
        "thesis2008": "omitted: another model, its error does not shrink (see weaknesses)",
        "radau": "omitted: dense factorisation of twice the modes, hours at this size",
        "lsoda": "omitted: turns to dense Jacobians, 2 to 44 s per ms when tried",
    }
    if importlib.util.find_spec("sksundae") is None:
        reasons["cvode"] = "omitted: scikit-sundae is not installed (pip install -e '.[dev]')"
    return [
        Point(name, scheme, "", math.nan, math.nan, math.nan, reason)
        for name in names
        for scheme, reason in reasons.items()
    ]


def run(folder: Path, quick: bool) -> list[Point]:
    """Measure, and write speed_accuracy.csv and speed_accuracy.png into `folder`."""
    names = list(_QUICK_SCENES if quick else _SCENES)
    points = [point for name in names for point in measure(name, _SCENES[name], 2 if quick else 5)]
    points += _omitted(names)
    write_records(folder / "speed_accuracy.csv", points)
    _draw(folder / "speed_accuracy.png", names, points)
    return points


def _draw(path: Path, names: list[str], points: list[Point]) -> None:
    figure, axes = pictures.sheet(1, len(names), width=5.0 * len(names), height=4.4)
    schemes = list(dict.fromkeys(p.scheme for p in points if not math.isnan(p.error)))
    for axis, name in zip(axes[0], names, strict=True):
        for i, scheme in enumerate(schemes):
            mine = [p for p in points if (p.scene, p.scheme, p.status[:2]) == (name, scheme, "ok")]
            mine += [p for p in points if (p.scene, p.scheme) == (name, scheme)
                     and p.status.startswith("estimate")]  # fmt: skip
            axis.loglog(
                [p.cpu_s_per_ms for p in mine], [p.error for p in mine], label=scheme,
                **pictures.look(i, True),
            )  # fmt: skip
        axis.set(title=name, xlabel="CPU time (s per simulated ms)", ylabel="error of the gap")
        axis.legend(fontsize=7)
    pictures.save(figure, path)


def cost_at(points: list[Point], scene: str, scheme: str, error: float) -> float:
    """CPU time (s per ms) that a scheme needs for an error, between its settings by powers."""
    mine = sorted(
        (p.error, p.cpu_s_per_ms)
        for p in points
        if (p.scene, p.scheme) == (scene, scheme) and 0.0 < p.error < 1.0
    )
    met = [cost for e, cost in mine if e <= error]
    return min(met) if met else math.nan


def ratios(points: list[Point]) -> dict[str, list[tuple[str, ...]]]:
    """The default scheme's cost against its competitors' at three errors, as rows to print."""
    found: dict[str, list[tuple[str, ...]]] = {}
    scenes = list(dict.fromkeys(p.scene for p in points))
    for competitor in ("dop853", "cvode", "dop853 compiled"):
        rows: list[tuple[str, ...]] = []
        for scene in scenes:
            for error in (1e-3, 1e-4, 1e-6):
                mine = cost_at(points, scene, "modal", error)
                other = cost_at(points, scene, competitor, error)
                cells = (f"{error:g}", f"{mine:.2e}", f"{other:.2e}", f"{other / mine:.3g}")
                rows.append((scene, *cells))
        found[f"modal against {competitor}"] = rows
    return found
