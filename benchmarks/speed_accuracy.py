"""Speed against accuracy: every scheme on the same modal equations of the same impacts.

Without control and plate damping, so that the energy must be kept; gap at common samples of the
first contact against the default scheme at a far smaller step, which tests hold to DOP853.
CPU times are measured in turn, round after round.
"""

import importlib.util
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks import integrator_kernels as ik
from benchmarks.program import (
    OutDirOption,
    QuickOption,
    conclude,
    median,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_records,
    written,
)
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from hertzloop.plant.contact.hertz import rigid_contact_time_s
from hertzloop.plant.numerics import phi
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.schemes.thesis2008 import ThesisPlant
from hertzloop.scene.setup import load
from hertzloop.studies import pictures

SAMPLE_S = 4e-6


class TooSlowError(Exception):
    """A run that was cut off; says after what."""


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
        return round(self.duration_s / SAMPLE_S)

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
    spec = load(name, ["contact.damping=none", "plate.loss_factor=0.0"]).plant
    spec = replace(spec, residual_flexibility=False, lead_in_s=0.0)
    modes = CollocationPlant(spec).modes
    drive = modes.scale_per_kg * modes.contact**2
    duration_s = math.ceil(duration_s / SAMPLE_S) * SAMPLE_S
    return Problem(name, spec, duration_s, modes.omega**2, drive)


def plant_run(make: type[Plant], what: Problem, step_s: float) -> Run:
    plant = make(replace(what.spec, step_s=step_s))
    kept = [array.copy() for array in plant.state]
    every = round(SAMPLE_S / step_s)
    gaps = np.empty(what.samples)

    def run() -> tuple[np.ndarray, float, float]:
        for array, value in zip(plant.state, kept, strict=True):
            array[:] = value
        started = time.process_time()
        ik.plant_gaps(plant.model, plant.state, every, gaps)
        cpu_s = time.process_time() - started
        return gaps.copy(), float(plant.close_balance().energy_residual), cpu_s

    return run


def kernel_run(kernel: Callable[..., None], what: Problem, step_s: float, *more: float) -> Run:
    every = round(SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        state, gaps = what.start(), np.empty(what.samples)
        started = time.process_time()
        kernel(state, *what.arguments, step_s, every * what.samples, every, gaps, *more)
        return gaps, what.drift(state), time.process_time() - started

    return run


def scipy_run(
    method: Any, what: Problem, tolerance: float, count: list[int], limit_s: float = math.inf
) -> Run:
    """A solver of SciPy with compiled right-hand side and Jacobian. `count[0]` becomes the number
    of evaluations. The run raises TooSlowError after `limit_s` of CPU time."""
    t = SAMPLE_S * np.arange(1, what.samples + 1)
    modes = len(what.omega2)
    more: dict[str, Any] = {}
    if method != "DOP853":
        more["jac"] = lambda t, y: ik.jacobian(y, *what.arguments)

    def run() -> tuple[np.ndarray, float, float]:
        started = time.process_time()

        def slope(time_s: float, y: np.ndarray) -> np.ndarray:
            if time.process_time() - started > limit_s:
                share = f"{time_s / t[-1]:.0%} of the time done at rtol {tolerance:g}"
                raise TooSlowError(f"stopped after {limit_s:g} s of CPU time, {share}")
            return np.asarray(ik.slope(time_s, y, *what.arguments))

        solved = solve_ivp(
            slope, (0.0, float(t[-1])), what.start(), method=method, t_eval=t,
            rtol=tolerance, atol=tolerance * 1e-6, **more,
        )  # fmt: skip
        cpu_s = time.process_time() - started
        count[0] = solved.nfev
        if not solved.success:
            raise TooSlowError(f"gave up: {solved.message}")
        plate = solved.y[:modes].sum(axis=0)
        drift = what.drift(np.ascontiguousarray(solved.y[:, -1]))
        return solved.y[2 * modes] - plate, drift, cpu_s

    return run


def cvode_run(what: Problem, tolerance: float) -> Run | None:
    """SUNDIALS CVODE, Adams with a matrix-free solver; None where scikit-sundae is missing."""
    try:
        from sksundae.cvode import CVODE
    except ImportError:
        return None
    t = SAMPLE_S * np.arange(what.samples + 1)
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


def dop853_run(what: Problem, tolerance: float) -> Run:
    """The compiled DOP853, tolerances as SciPy's."""

    def run() -> tuple[np.ndarray, float, float]:
        state, gaps = what.start(), np.empty(what.samples)
        started = time.process_time()
        ik.dop853(
            state, *what.arguments, SAMPLE_S, gaps, tolerance, 1e-6 * tolerance, 1e-6, False
        )  # fmt: skip
        cpu_s = time.process_time() - started
        return gaps, what.drift(state), cpu_s

    return run


def quadratised_run(what: Problem, step_s: float) -> Run:
    """The non-iterative scheme; its coefficients are made before the clock starts."""
    omega = np.sqrt(what.omega2)
    change = what.drive / omega * step_s * phi(1, 1j * omega * step_s)
    turn = np.exp(1j * omega * step_s)
    table = np.ascontiguousarray([turn.real, turn.imag, change.real, change.imag])
    mass = what.spec.sphere.mass_kg
    gain = float(change.imag.sum()) + 0.5 * step_s**2 / mass
    every = round(SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        z, gaps = np.zeros((2, len(omega))), np.empty(what.samples)
        body = np.array([0.0, -what.spec.sphere.impact_speed_m_s, 0.0, 0.0])
        started = time.process_time()
        ik.quadratised(
            z, body, table, gain, what.spec.contact.stiffness, mass, step_s, every, gaps
        )  # fmt: skip
        cpu_s = time.process_time() - started
        state = np.concatenate([z[1], omega * z[0], body[:2]])
        return gaps, what.drift(state), cpu_s

    return run


def convolution_run(what: Problem, step_s: float) -> Run:
    """Direct sums; the Green's function is sampled before the clock starts."""
    every = round(SAMPLE_S / step_s)
    steps = every * what.samples
    omega, mass = np.sqrt(what.omega2), what.spec.sphere.mass_kg
    speed = what.spec.sphere.impact_speed_m_s
    response, force = np.zeros(steps + 1), np.zeros(steps + 1)
    ik.sampled_response(omega, what.drive, mass, step_s, response)

    def run() -> tuple[np.ndarray, float, float]:
        gaps, state = np.empty(what.samples), what.start()
        started = time.process_time()
        ik.convolution(response, force, speed, what.spec.contact.stiffness, step_s, every, gaps)
        cpu_s = time.process_time() - started
        ik.state_after(omega, what.drive, force, step_s, mass, speed, state)
        return gaps, what.drift(state), cpu_s

    return run


def collocation_run(
    what: Problem, step_s: float, stages: int, levels: int | None = None, height_m: float = 0.0
) -> Run:
    """Exponential collocation at `stages` Gauss nodes; the tables are made before the clock starts.

    `levels`: of halving; by default so many that the error of the shortest sub-step, which grows
    as its length to 2.5, falls with the order of the rest, 2 stages. The sphere starts `height_m`
    above the plate.
    """
    spec, omega = what.spec, np.sqrt(what.omega2)
    mass, stiffness = spec.sphere.mass_kg, spec.contact.stiffness
    scale_s = 0.5 * rigid_contact_time_s(mass, stiffness, spec.sphere.impact_speed_m_s)
    if levels is None:
        shrinks = (2.0 * stages / 2.5 - 1.0) * math.log2(scale_s / step_s)
        levels = 3 + max(0, math.ceil(shrinks))
    nodes = np.append(0.5 * np.polynomial.legendre.leggauss(stages)[0] + 0.5, 1.0)
    # Lagrange polynomials in powers of t/h, column j that of node j.
    powers = np.linalg.inv(np.vander(nodes[:-1], increasing=True))
    lengths = step_s * 0.5 ** np.arange(levels)
    times = np.outer(lengths, nodes)
    turns = np.empty((levels, stages + 1, 2, len(omega)))
    changes = np.empty((levels, stages, 2, len(omega)))
    gains, speed_gains = np.empty((levels, stages + 1, stages)), np.empty((levels, stages))
    for level, h in enumerate(lengths):
        for i, c in enumerate(nodes):
            x = 1j * omega * c * h
            turns[level, i] = np.exp(x).real, np.exp(x).imag
            # Change of z, and of the sphere, by (t/h)^p from 0 to c h.
            plate = [math.factorial(p) * c**p * c * h * phi(p + 1, x) for p in range(stages)]
            sphere = [c**p * (c * h) ** 2 / ((p + 1) * (p + 2)) / mass for p in range(stages)]
            answer = (what.drive / omega) * (powers.T @ np.array(plate))
            gains[level, i] = powers.T @ np.array(sphere) + answer.imag.sum(axis=1)
        changes[level, :, 0], changes[level, :, 1] = answer.real, answer.imag
        speed_gains[level] = powers.T @ (h / (1.0 + np.arange(stages))) / mass
    every = round(SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        z, gaps = np.zeros((2, len(omega))), np.empty(what.samples)
        speed = -spec.sphere.impact_speed_m_s
        body = np.array([height_m, speed, height_m, speed])
        started = time.process_time()
        ik.collocation(
            z, body, omega, times, turns, changes, gains, speed_gains, stiffness, scale_s, every,
            gaps,
        )  # fmt: skip
        cpu_s = time.process_time() - started
        return gaps, what.drift(np.concatenate([z[1], omega * z[0], body[:2]])), cpu_s

    return run


def thesis_run(what: Problem, step_s: float) -> Run:
    """The published scheme taken literally, with its own modes up to pi/dt."""
    every = round(SAMPLE_S / step_s)

    def run() -> tuple[np.ndarray, float, float]:
        plant = ThesisPlant(replace(what.spec, step_s=step_s), every * what.samples)
        gaps = np.empty(what.samples)
        started = time.process_time()
        ik.plant_gaps(plant.model, plant.state, every, gaps)
        cpu_s = time.process_time() - started
        return gaps, float(plant.close_balance().energy_residual), cpu_s

    return run


# The default scheme is in both rows, as series 0.
_FAMILIES = {
    "textbook and second-order schemes": (
        "modal", "discrete_gradient", "quadratised", "convolution", "verlet", "rk4", "newmark",
        "hht",
    ),
    "high-order and adaptive schemes": (
        "modal", "collocation-s1", "collocation-s2", "collocation-s3", "dop853 compiled", "dop853",
        "cvode", "lsoda",
    ),
}  # fmt: skip


def draw(path: Path, names: Sequence[str], points: Sequence[Any]) -> None:
    """Error of the gap against CPU time; a row a family, a column a scene. Schemes that
    were left out are below, with the reason."""
    metric, axes = pictures.sheet(len(_FAMILIES), len(names), 4.6 * len(names) + 2.0, 3.9)
    for row, (family, schemes) in zip(axes, _FAMILIES.items(), strict=True):
        for axis, name in zip(row, names, strict=True):
            for i, scheme in enumerate(schemes):
                mine = [p for p in points if (p.scene, p.scheme, p.status) == (name, scheme, "ok")]
                axis.loglog(
                    [p.cpu_s_per_ms for p in mine], [p.error for p in mine],
                    label=scheme, **pictures.look(i, True),
                )  # fmt: skip
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


def run(folder: Path, quick: bool) -> list[Point]:
    """Measure, and write speed_accuracy.csv and speed_accuracy.png into `folder`."""
    names = list(_QUICK_SCENES if quick else _SCENES)
    rounds, limit_s = (2, _QUICK_LIMIT_S) if quick else (5, _LIMIT_S)
    points = [p for name in names for p in measure(name, _SCENES[name], rounds, limit_s)]
    if importlib.util.find_spec("sksundae") is None:
        reason = "scikit-sundae is not installed (pip install -e '.[dev]')"
        points += [_left_out(name, "cvode", "", reason) for name in names]
    write_records(folder / "speed_accuracy.csv", points)
    draw(folder / "speed_accuracy.png", names, points)
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


def ratios(points: list[Point]) -> dict[str, list[tuple[str, ...]]]:
    """The default scheme's cost against its competitors' at three errors, as rows to print."""
    found: dict[str, list[tuple[str, ...]]] = {}
    scenes = list(dict.fromkeys(p.scene for p in points))
    for competitor, schemes in _COMPETITORS.items():
        rows: list[tuple[str, ...]] = []
        for scene in scenes:
            for error in (1e-3, 1e-4, 1e-6):
                mine = cost_at(points, scene, "modal", error)
                costs = [cost_at(points, scene, scheme, error) for scheme in schemes]
                other = min((c for c in costs if not math.isnan(c)), default=math.nan)
                cells = (f"{error:g}", f"{mine:.2e}", f"{other:.2e}", f"{other / mine:.3g}")
                rows.append((scene, *cells))
        found[f"modal against {competitor}"] = rows
    return found


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
    with results_in(folder, "speed_accuracy", "modal") as made:
        points = run(made, quick)
    for title, rows in ratios(points).items():
        headings = ("scene", "error", "modal (s/ms)", "competitor (s/ms)", "times faster")
        out.print(number_table(title, headings, rows))
    written(made, "speed_accuracy.csv", "speed_accuracy.png")
    conclude(conclusion(points))


if __name__ == "__main__":
    start("benchmarks.speed_accuracy")
