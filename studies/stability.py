"""Where methods fail: blow up, lose the energy, or let the actuator feed energy without bound.

Four charts: growth of a free vibration against w h; energy lost or gained over one contact against
the step; the default scheme's energy residual over sphere mass and step; the closed loop over
gain and latency.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hertzloop.compiled import simulate
from hertzloop.impact_rows import consistent_impacts
from hertzloop.scene import load
from plant.collocation import CollocationPlant
from plant.contact import hertz_stiffness, rigid_contact_time_s
from plant.plant import Plant
from studies import integrator_kernels as ik
from studies import kernels as k
from studies import pictures
from studies.speed_cases import Problem, problem
from studies.tabular import write_records, write_rows

LIMITS = {"verlet": 2.0, "rk4": 2.0 * math.sqrt(2.0)}  # of w h, for a free vibration
_KERNELS: dict[str, tuple[Callable[..., None], tuple[float, ...]]] = {
    "verlet": (ik.verlet, ()),
    "rk4": (ik.rk4, ()),
    "newmark": (ik.alpha_method, (0.0,)),
    "hht": (ik.alpha_method, (-0.1,)),
}
_FREE_STEPS = 400
_KAPPAS = np.linspace(0.0, 2.0, 21)
_LATENCIES_US = np.arange(0, 61, 3)


@dataclass(frozen=True)
class LoopPoint:
    """First impact with the law at one gain and latency: energies over the impact's energy."""

    kappa: float
    latency_us: float
    injected: float
    plate_energy_db: float  # against no control
    contact_us: float


def growth_per_step(scheme: str, phase: float) -> float:
    """Factor by which a free vibration with w h = `phase` grows in a step: the largest
    eigenvalue of the step from (q, q'/w) to the next. Hilber-Hughes-Taylor's step has an
    acceleration of its own as well; there the growth over many steps is taken."""
    kernel, more = _KERNELS[scheme]

    def after(q: float, v: float, steps: int) -> np.ndarray:
        y = np.array([q, v * phase, 1e9, 0.0])  # the sphere is far away
        kernel(
            y, np.array([phase * phase]), np.array([1.0]), 1.0, 1.0, 1.0, steps, 1,
            np.empty(steps), *more,
        )  # fmt: skip
        return np.array([y[0], y[1] / phase])

    if scheme == "hht":
        size = float(np.linalg.norm(after(1.0, 0.0, _FREE_STEPS)))
        return size ** (1.0 / _FREE_STEPS)
    matrix = np.column_stack([after(1.0, 0.0, 1), after(0.0, 1.0, 1)])
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def growth() -> Iterator[tuple[str, float, float]]:
    """Scheme, w h, growth per step."""
    for scheme in _KERNELS:
        for phase in np.arange(0.05, 4.0, 0.05):
            yield scheme, float(phase), growth_per_step(scheme, float(phase))


def _few_modes() -> Problem:
    """The light ball on the modes up to 30 kHz: what fails below is the contact, not the modes."""
    what = problem("aluminium-3mm", 6e-5)
    keep = np.sqrt(what.omega2) < 2.0 * math.pi * 30e3
    spec = replace(what.spec, frequency_limit_hz=30e3)
    return Problem(what.name, spec, what.duration_s, what.omega2[keep], what.drive[keep])


def contact_drift() -> Iterator[tuple[str, float, float]]:
    """Scheme, step over contact time, relative change of the energy over one contact."""
    what = _few_modes()
    sphere = what.spec.sphere
    lasts_s = rigid_contact_time_s(
        sphere.mass_kg, what.spec.contact.stiffness, sphere.impact_speed_m_s
    )
    for share in np.geomspace(3e-3, 3.0, 31):
        step_s = float(share * lasts_s)
        steps = max(math.ceil(2.0 * lasts_s / step_s), 3)
        for scheme, (kernel, more) in _KERNELS.items():
            y = what.start()
            with np.errstate(over="ignore", invalid="ignore"):
                kernel(y, *what.arguments, step_s, steps, 1, np.empty(steps), *more)
            yield scheme, float(share), abs(what.drift(y))
        for make in (Plant, CollocationPlant):
            plant = make(replace(what.spec, step_s=step_s))
            k.plant_steps(plant.model, plant.state, 0.0, steps)
            yield make.scheme, float(share), abs(plant.close_books().energy_residual)


def residual_map() -> Iterator[tuple[float, float, float, int]]:
    """Sphere mass over plate impedance times contact time, step over contact time, the default
    scheme's energy residual after three bounces' time on a plate that vibrates from the first on,
    most evaluations of a step."""
    base = _few_modes().spec
    for radius in np.geomspace(3e-4, 3e-2, 13):
        sphere = replace(base.sphere, radius_m=float(radius))
        stiffness = hertz_stiffness(float(radius), sphere.material, base.plate.material)
        contact = replace(base.contact, stiffness=stiffness)
        lasts_s = rigid_contact_time_s(sphere.mass_kg, stiffness, sphere.impact_speed_m_s)
        ratio = sphere.mass_kg / (base.plate.infinite_plate_impedance_n_s_m * lasts_s)
        for share in np.geomspace(1e-2, 100.0, 13):
            spec = replace(base, sphere=sphere, contact=contact, step_s=float(share * lasts_s))
            plant = CollocationPlant(spec)
            k.plant_steps(plant.model, plant.state, 0.0, 2000)
            books = plant.close_books()
            yield ratio, float(share), abs(books.energy_residual), books.newton_iterations_max


def loop_map(name: str = "aluminium-3mm") -> Iterator[LoopPoint]:
    """The slope-threshold law's first impact over gain and latency."""
    lasts = "run.duration_s=0.0016"
    off = load(name, [lasts, "controller.law=off"])
    free = consistent_impacts(off, simulate(off).rows)[0]
    for kappa in _KAPPAS:
        for latency_us in _LATENCIES_US:
            keys = [f"controller.kappa={kappa:.3f}", f"controller.latency_us={latency_us}"]
            scene = load(name, [lasts, *keys])
            truth = simulate(scene)
            first = consistent_impacts(scene, truth.rows)[0]
            yield LoopPoint(
                float(kappa),
                float(latency_us),
                truth.books.injected_j / truth.books.energy_start_j,
                10.0 * math.log10(first.plate_energy_j / free.plate_energy_j),
                1e6 * first.duration_s,
            )


def run(folder: Path) -> dict[str, str]:
    """Measure all, write stability.png and four CSV files; key figures to print."""
    free, contact = list(growth()), list(contact_drift())
    residuals, loop = list(residual_map()), list(loop_map())
    write_rows(folder / "stability-growth.csv", ["scheme", "omega_h", "growth_per_step"], free)
    write_rows(folder / "stability-contact.csv", ["scheme", "step_over_contact", "drift"], contact)
    write_rows(
        folder / "stability-residual.csv",
        ["mass_over_impedance_time", "step_over_contact", "energy_residual", "evaluations"],
        residuals,
    )
    write_records(folder / "stability-loop.csv", loop)
    _draw(folder / "stability.png", free, contact, residuals, loop)
    found = {}
    for scheme, limit in LIMITS.items():
        grows = [phase for name, phase, factor in free if name == scheme and factor > 1.0 + 1e-9]
        found[f"{scheme} grows from w h ="] = f"{min(grows):.2f} (predicted {limit:.2f})"
    worst = max(residual for _, _, residual, _ in residuals)
    found["modal: worst energy residual, steps of 0.01 to 100 contact times"] = f"{worst:.1e}"
    most = max(loop, key=lambda p: p.injected)
    found["most energy fed in by the actuator, of the impact's"] = (
        f"{most.injected:.2f} at kappa {most.kappa:g}, latency {most.latency_us:g} us"
    )
    better = [p for p in loop if p.plate_energy_db < -0.1]
    found["settings that take 0.1 dB or more off the plate"] = f"{len(better)} of {len(loop)}"
    return found


def _draw(path: Path, free: list, contact: list, residuals: list, loop: list) -> None:
    figure, axes = pictures.sheet(2, 2, width=11.0, height=4.0)
    for i, scheme in enumerate(_KERNELS):
        mine = [(x, g) for name, x, g in free if name == scheme and g < 3.0]
        axes[0, 0].plot(*zip(*mine, strict=True), label=scheme, **pictures.look(i))
    for limit in LIMITS.values():
        axes[0, 0].axvline(limit, color="gray", linewidth=0.8)
    axes[0, 0].axhline(1.0, color="black", linewidth=0.8, label="modal, discrete_gradient: exact")
    axes[0, 0].set(title="Free vibration", xlabel="w h", ylabel="growth per step", ylim=(0.6, 2.0))
    axes[0, 0].legend()
    for i, scheme in enumerate([*_KERNELS, "discrete_gradient", "modal"]):
        mine = [(x, max(d, 1e-17)) for name, x, d in contact if name == scheme and d < 1e3]
        axes[0, 1].loglog(*zip(*mine, strict=True), label=scheme, **pictures.look(i, True))
    axes[0, 1].set(
        title="Energy changed by one contact", xlabel="step / contact time", ylabel="relative"
    )
    axes[0, 1].legend(fontsize=7)
    x, y, c = (np.array([row[j] for row in residuals]) for j in range(3))
    shown = axes[1, 0].scatter(x, y, c=np.log10(np.maximum(c, 1e-17)), cmap="viridis", marker="s")
    axes[1, 0].set(
        title="modal: log10 of the energy residual", xscale="log", yscale="log",
        xlabel="sphere mass / (plate impedance x contact time)", ylabel="step / contact time",
    )  # fmt: skip
    figure.colorbar(shown, ax=axes[1, 0])
    shape = (len(_KAPPAS), len(_LATENCIES_US))
    change = np.array([p.plate_energy_db for p in loop]).reshape(shape)
    fed = np.array([p.injected for p in loop]).reshape(shape)
    shown = axes[1, 1].contourf(_LATENCIES_US, _KAPPAS, change, 16, cmap="viridis")
    lines = axes[1, 1].contour(_LATENCIES_US, _KAPPAS, change, [0.0], colors="white")
    axes[1, 1].clabel(lines, fmt="no better than none")
    dashed = axes[1, 1].contour(
        _LATENCIES_US, _KAPPAS, fed, [0.1, 0.5], colors="black", linestyles="--"
    )
    axes[1, 1].clabel(dashed, fmt="fed in %.1f")
    axes[1, 1].set(
        title="aluminium-3mm: plate energy against none (dB)", xlabel="latency (us)",
        ylabel="kappa",
    )  # fmt: skip
    figure.colorbar(shown, ax=axes[1, 1])
    pictures.save(figure, path)
