"""Where the published numerics fail, beside the consistent scheme.

Four checks without control: contact impulse against momentum change; contact time and rebound
as the step shrinks; Newton's iterations under relaxation damping; the sign of its force.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Patch

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.schemes import discrete_gradient_kernels
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from hertzloop.loop.simulate import simulate
from hertzloop.plant.contact.hertz import (
    Contact,
    Damping,
    Sphere,
    hertz_stiffness,
    rigid_contact_time_s,
)
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes import thesis2008_kernels as k
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.schemes.thesis2008 import ThesisPlant
from hertzloop.plant.state_kernels import (
    CONTACT_STEPS,
    GRAVITY_M_S2,
    NEWTON_MAX,
    NEWTON_TOTAL,
    STEP,
    XI,
)
from hertzloop.plant.time_series import F_C
from hertzloop.results.impacts import first_impact
from hertzloop.scene.setup import Setup, load
from hertzloop.studies.pages import pictures
from paper.restitution import calibrate_relaxation, calibrate_viscous, first_contact

_LAW = "controller.law=slope_threshold"
_OFF = "controller.law=off"
_LASTS = "run.duration_s=0.06"  # all contacts of the first arrival


@dataclass(frozen=True)
class LawEffect:
    """kappa = 0.8, v_thr = -0.25 m/s without latency, against no control.

    Speeds: of the sphere when it leaves for good (consistent: after the last contact within
    60 ms); energies: work on the plate in all these contacts.
    """

    sphere: str
    scheme: str
    leaves_m_s: float
    without_m_s: float
    height_percent: float
    plate_mj: float
    without_mj: float
    plate_db: float


def law_effects() -> list[LawEffect]:
    """Both spheres, both schemes."""
    found = []
    for radius_mm in (3, 20):
        radius = f"sphere.radius_m={radius_mm / 1000}"
        spec = load("thesis-aluminium", [radius]).plant
        damping = calibrate_viscous(spec, spec.plate.material.restitution)
        published = [radius, f"contact.viscous_n_s_m={damping!r}"]
        for source, settings, measure in (
            ("thesis-aluminium", published, _published),
            (f"aluminium-{radius_mm}mm", [_LASTS], _consistent),
        ):
            speed, energy = measure(load(source, [*settings, _LAW]))
            speed_0, energy_0 = measure(load(source, [*settings, _OFF]))
            found.append(
                LawEffect(
                    sphere=f"R = {radius_mm} mm",
                    scheme=load(source).scheme,
                    leaves_m_s=speed,
                    without_m_s=speed_0,
                    height_percent=100.0 * (speed / speed_0) ** 2,
                    plate_mj=1e3 * energy,
                    without_mj=1e3 * energy_0,
                    plate_db=10.0 * math.log10(energy / energy_0),
                )
            )
    return found


def _published(setup: Setup) -> tuple[float, float]:
    impact = first_impact(setup, simulate(setup).truth)
    if impact is None or not impact.ended:
        raise ValueError(f"{setup.name}: the first contact does not end within the run")
    return impact.noise.next_impact_speed_m_s, impact.noise.transmitted_j


def _consistent(setup: Setup) -> tuple[float, float]:
    found = impacts_in(setup.plant, simulate(setup).truth)
    return found[-1].rebound_speed_m_s, sum(impact.plate_energy_j for impact in found)


def _bars(axes: Any, labels: list[str], values: list[float], published: list[bool]) -> None:
    for i, (value, is_published) in enumerate(zip(values, published, strict=True)):
        axes.barh(
            i,
            value,
            color=pictures.COLOURS[1 if is_published else 0],
            hatch="//" if is_published else "",
            edgecolor="black",
            linewidth=0.5,
        )
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)


_CALLED = {"modal": "consistent", "thesis2008": "published"}


def draw(path: Path, steps_us: tuple[float, ...], checks: dict[str, list[Any]]) -> None:
    """Draw the rows of all checks, by their names in `main`."""
    figure, axes = pictures.sheet(2, 2, width=13.0, height=4.6)
    rows = checks["momentum"]
    ratios = [row.ratio for row in rows]
    _bars(
        axes[0, 0], [r.scene for r in rows], ratios, [not SCHEMES[r.scheme].conserves for r in rows]
    )
    axes[0, 0].set(
        title="Does the contact force change the sphere's momentum?",
        xscale="log",
        xlim=(1e-5, 2),
        xlabel="contact impulse / momentum change (1 is right)",
    )
    for i, scheme in enumerate(("modal", "thesis2008")):
        mine = [row for row in checks["refinement"] if row.scheme == scheme]
        mine = [row for row in mine if row.rebound_error > 0.0]
        style = partial(pictures.look, i, True)
        axes[0, 1].loglog(
            [r.step_us for r in mine],
            [r.rebound_error for r in mine],
            label=_CALLED[scheme],
            **style(),
        )
    steps = np.array(steps_us)
    axes[0, 1].loglog(steps, 2e-5 * steps**2, color="gray", linestyle=":", label="order 2")
    axes[0, 1].set(
        title="Rebound speed as the step shrinks",
        xlabel="step (us)",
        ylabel="change against the finest step / impact speed",
    )
    axes[0, 1].set_xticks(steps, [f"{step:g}" for step in steps_us])
    axes[0, 1].minorticks_off()
    axes[0, 1].legend()
    found = checks["iterations"]
    labels = [
        f"{r.case}: {r.solve.replace('relaxation, ', 'relaxation ')}"
        + (f", {r.never} never end" if r.never else "")
        for r in found
    ]
    largest = [float(row.largest) for row in found]
    _bars(axes[1, 0], labels, largest, ["published" in row.solve for row in found])
    axes[1, 0].set(
        title="Work of one solve of the contact",
        xscale="log",
        xlabel="largest number of evaluations (100 000: cut there)",
    )
    axes[1, 0].tick_params(axis="y", labelsize=7)
    pulls = checks["adhesion"]
    shares = [100.0 * row.share for row in pulls]
    _bars(axes[1, 1], [row.scene for row in pulls], shares, [True] * len(pulls))
    axes[1, 1].set(
        title="Does the contact pull? (relaxation damping)",
        xlabel="most negative contact force (% of the largest)",
    )
    known = [
        Patch(facecolor=pictures.COLOURS[1], hatch="//", edgecolor="black", label="published"),
        Patch(facecolor=pictures.COLOURS[0], edgecolor="black", label="consistent"),
    ]
    figure.legend(handles=known, loc="outside upper center", ncols=2)
    pictures.save(figure, path)


MATERIALS = ("aluminium", "oak", "sylomer")
STEPS_US = (4.0, 2.0, 1.0, 0.5, 0.25)
_REFERENCE_US = 0.0625
# Time constants (s) at which the target restitution is reached, the published one where it is.
RELAXATION_S = {"aluminium": 0.0025, "oak": 0.5, "sylomer": 1e-3}
ITERATIONS_ALLOWED = 100_000  # then a solve counts as one that never ends
_CASES = 150


@dataclass(frozen=True)
class Momentum:
    """Impulse of the contact against the sphere's momentum change, N s, first impact."""

    scene: str
    scheme: str
    contact_impulse_n_s: float
    momentum_change_n_s: float  # gravity's share taken off
    ratio: float


@dataclass(frozen=True)
class Refinement:
    """First contact on aluminium at one step length; errors against the finest, in per cent
    of its value (consistent scheme) or against its own finest (published)."""

    scheme: str
    step_us: float
    contact_time_us: float
    rebound_m_s: float
    rebound_error: float  # relative to the impact speed, against the reference


@dataclass(frozen=True)
class Iterations:
    """Evaluations that the contact's solve took over an impact with relaxation damping."""

    case: str
    solve: str
    largest: int
    mean: float
    never: int  # impacts with a solve that did not end within ITERATIONS_ALLOWED
    impacts: int


@dataclass(frozen=True)
class Adhesion:
    """Most negative contact force under relaxation, as a share of the largest."""

    scene: str
    restitution: float
    share: float


def momentum() -> list[Momentum]:
    """Impulse and momentum change of the first impact, both schemes, three plates."""
    found = []
    for name in MATERIALS:
        for source in (f"thesis-{name}", f"{name}-20mm"):
            scene = load(source, ["controller.law=off"])
            rows = simulate(scene).truth
            impact = first_impact(scene, rows)
            if impact is None:
                raise ValueError(f"{source}: no impact")
            # A contact that the run cuts off has its speed at the last step but one.
            last = impact.end if impact.ended else impact.end - 2
            force = rows[F_C, impact.start : last]
            impulse = float(np.sum(force)) * scene.step_s
            mass = scene.plant.sphere.mass_kg
            noise = impact.noise
            change = mass * (noise.impact_speed_m_s + noise.next_impact_speed_m_s)
            change += mass * GRAVITY_M_S2 * len(force) * scene.step_s
            found.append(Momentum(source, scene.scheme, impulse, change, impulse / change))
    return found


def refinement() -> list[Refinement]:
    """Contact time and rebound of the first impact on aluminium under smaller steps.

    Published: all modes to pi/dt, as it prescribes, with the damping calibrated at 1 us.
    Consistent: the 125 kHz that the largest step carries at every step, so that what changes is
    the step alone.
    """
    found = []
    for scheme, measure, finest in (
        ("thesis2008", _published_contact, STEPS_US[-1]),
        ("modal", _consistent_contact, _REFERENCE_US),
    ):
        reference = measure(finest)[1]
        for step_us in STEPS_US:
            time_us, rebound = measure(step_us)
            found.append(
                Refinement(scheme, step_us, time_us, rebound, abs(rebound - reference) / 0.99045)
            )
    return found


def _published_contact(step_us: float) -> tuple[float, float]:
    scene = load(
        "thesis-aluminium",
        ["controller.law=off", "controller.lead_us=0", f"run.step_ns={round(step_us * 1000)}"],
    )
    impact = first_impact(scene, simulate(scene).truth)
    if impact is None or not impact.ended:
        raise ValueError(f"the published contact does not end at a step of {step_us} us")
    return impact.noise.contact_time_s * 1e6, impact.noise.next_impact_speed_m_s


def _consistent_contact(step_us: float) -> tuple[float, float]:
    spec = load("aluminium-20mm").plant
    spec = replace(
        spec, step_s=step_us * 1e-6, frequency_limit_hz=125e3, lead_in_s=10.0 * step_us * 1e-6
    )
    return consistent_first_contact(spec, 2e-3)


def consistent_first_contact(spec: PlantSpec, longest_s: float) -> tuple[float, float]:
    """Contact time (us) and sphere speed (m/s) after the first contact without control."""
    plant = DiscreteGradientPlant(spec)
    body = plant.state.body
    began = None
    for _ in range(round(longest_s / spec.step_s)):
        gap = float(body[XI])
        discrete_gradient_kernels.step(plant.model, plant.state, 0.0)
        after = float(body[XI])
        at = (float(plant.state.counts[STEP]) - after / (after - gap)) if after != gap else 0.0
        if began is None and after < 0.0:
            began = at
        elif began is not None and after > 0.0:
            late_s = (float(plant.state.counts[STEP]) - at) * spec.step_s
            speed = plant.sphere_speed_m_s() + GRAVITY_M_S2 * late_s
            return (at - began) * spec.step_s * 1e6, speed
    raise ValueError(f"the first contact does not end within {longest_s} s")


def _relaxing(spec: PlantSpec, s_tau: float, tau_s: float, *, extra_state: bool) -> PlantSpec:
    contact = Contact(
        spec.contact.stiffness,
        Damping.RELAXATION,
        relaxation_stiffness=s_tau,
        relaxation_s=tau_s,
        extra_state=extra_state,
    )
    return replace(spec, contact=contact)


def calibrated() -> dict[str, PlantSpec]:
    """The three plates with relaxation damping for the assumed restitution, bracketed solve."""
    found = {}
    for name in MATERIALS:
        scene = load(f"thesis-{name}")
        spec, tau = scene.plant, RELAXATION_S[name]
        s_tau = calibrate_relaxation(spec, spec.plate.material.restitution, tau)
        found[name] = _relaxing(spec, s_tau, tau, extra_state=True)
    return found


def _count(spec: PlantSpec, steps: int = 4000) -> tuple[int, int, int, bool]:
    """Largest and total iterations, steps, whether a solve never ended."""
    plant = ThesisPlant(spec, steps, most_iterations=ITERATIONS_ALLOWED)
    first_contact(plant, steps)
    counts = plant.state.counts
    largest, total = int(counts[NEWTON_MAX]), int(counts[NEWTON_TOTAL])
    return largest, total, int(counts[CONTACT_STEPS]), bool(counts[k.GAVE_UP])


def iterations(cases: int = _CASES, seed: int = 1) -> list[Iterations]:
    """Evaluations per solve: viscous, relaxation as published, relaxation as one extra state.

    The calibrated impacts, then random ones on aluminium (radius 20 and 3 mm, drop height
    0.1 mm to 1 m, memory taking 0.1 to 0.9 of the stiffness over the contact).
    """
    found = []
    for name, spec in calibrated().items():
        viscous = load(f"thesis-{name}").plant
        published = replace(spec, contact=replace(spec.contact, extra_state=False))
        for solve, one in (
            ("viscous, published", viscous),
            ("relaxation, published", published),
            ("relaxation, extra state", spec),
        ):
            found.append(_summary(f"{name}, calibrated", solve, [_count(one)]))
    for radius in (0.02, 0.003):
        random = np.random.default_rng(seed)
        specs = [_random_case(radius, random) for _ in range(cases)]
        for solve, extra in (("relaxation, published", False), ("relaxation, extra state", True)):
            counts = [
                _count(replace(one, contact=replace(one.contact, extra_state=extra)))
                for one in specs
            ]
            found.append(_summary(f"aluminium, R = {radius * 1e3:g} mm, random", solve, counts))
    return found


def _random_case(radius_m: float, random: np.random.Generator) -> PlantSpec:
    spec = load("thesis-aluminium").plant
    height, part = 10 ** random.uniform(-4, 0), random.uniform(0.1, 0.9)
    sphere = Sphere(spec.sphere.material, radius_m, height)
    s = hertz_stiffness(radius_m, sphere.material, spec.plate.material)
    # The published contact of the heavy sphere takes 34 us whatever its mass would say.
    lasts = rigid_contact_time_s(sphere.mass_kg, s, sphere.impact_speed_m_s)
    lasts = min(lasts, 34e-6)
    tau = RELAXATION_S["aluminium"]
    contact = replace(spec.contact, stiffness=s)
    sized = replace(spec, sphere=sphere, contact=contact)
    return _relaxing(sized, part * s * tau / lasts, tau, extra_state=True)


def _summary(case: str, solve: str, counts: list[tuple[int, int, int, bool]]) -> Iterations:
    total, steps = sum(c[1] for c in counts), sum(c[2] for c in counts)
    never = sum(c[3] for c in counts)
    return Iterations(case, solve, max(c[0] for c in counts), total / steps, never, len(counts))


def adhesion() -> list[Adhesion]:
    """Most negative contact force over the largest, for the calibrated relaxation."""
    found = []
    for name, spec in calibrated().items():
        plant = ThesisPlant(spec, 4000)
        forces = []
        while not (plant.state.counts[k.TOUCHING] and plant.state.body[XI] > 0.0):
            forces.append(k.step(plant.model, plant.state, 0.0))
        speed = float(plant.state.motion[k.REL_V]) / spec.sphere.impact_speed_m_s
        found.append(Adhesion(f"thesis-{name}", speed, min(forces) / max(forces)))
    return found


_QUICK_CASES = 10


def _cell(name: str) -> Callable[[Any], str]:
    """The text of a field."""

    def text(row: Any) -> str:
        value = getattr(row, name)
        if isinstance(value, float):
            return f"{value:.4g}"
        return f"{value:,}" if isinstance(value, int) else str(value)

    return text


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Show where the published numerics fail, beside the consistent scheme.

    With --quick: fewer random cases.

    Example: python -m paper.weaknesses --quick
    """
    measures: dict[str, tuple[str, Callable[[], list[Any]]]] = {
        "momentum": ("Contact impulse against momentum change", momentum),
        "refinement": ("First contact on aluminium under smaller steps", refinement),
        "iterations": (
            "Evaluations a solve of the contact takes",
            partial(iterations, _QUICK_CASES if quick else _CASES),
        ),
        "adhesion": ("Pulling force under relaxation damping", adhesion),
        "law": ("What the law does: kappa = 0.8, v_thr = -0.25 m/s", law_effects),
    }
    with results_in(folder, "weaknesses", "modal", "thesis2008") as results:
        checks: dict[str, list[Any]] = {}
        for name, (title, measure) in tracked("weaknesses", measures.items()):
            rows = checks[name] = measure()
            results.write(f"weaknesses-{name}", rows)
            names = [field.name for field in fields(rows[0])]
            columns = {name.replace("_", " "): _cell(name) for name in names}
            results.table(title, columns, rows, text=0)
        draw(results.path("weaknesses.png"), STEPS_US, checks)
        ratios: dict[str, list[float]] = {}
        for one in checks["momentum"]:
            ratios.setdefault(one.scheme, []).append(one.ratio)
        off = max(abs(ratio - 1.0) for ratio in ratios["modal"])
        results.conclude(
            f"The contact impulse of the published scheme is at most "
            f"{100.0 * max(ratios['thesis2008']):.2g} % of the momentum change; that of the "
            f"default scheme equals it within {off:.0e} of its size."
        )


if __name__ == "__main__":
    start("paper.weaknesses")
