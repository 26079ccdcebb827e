"""Stability limits of the textbook integrators: predicted, and found by running their kernels.

Free vibration with and without damping; and a sphere at rest on the plate, where the contact is a
spring for as long as one likes, so that the limit of the linearised equations holds exactly.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import astuple, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from benchmarks import integrator_kernels as ik
from benchmarks.program import (
    OutDirOption,
    QuickOption,
    conclude,
    out,
    progress,
    results_in,
    start,
    write_records,
    written,
)
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from benchmarks.speed_accuracy import Problem, problem
from hertzloop.loop.simulate import simulate
from hertzloop.plant.contact.hertz import hertz_stiffness, rigid_contact_time_s
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes import collocation_kernels as collocation
from hertzloop.plant.schemes import thesis2008_kernels as tk
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.schemes.thesis2008 import ThesisPlant
from hertzloop.plant.state_kernels import V_P
from hertzloop.plant.structures.structure import oscillators
from hertzloop.scene.setup import load
from hertzloop.studies import pictures
from hertzloop.studies.words import write_rows

Kernel = tuple[Callable[..., None], tuple[float, ...]]
TEXTBOOK: dict[str, Kernel] = {
    "verlet": (ik.verlet, ()),
    "rk4": (ik.rk4, ()),
    "newmark": (ik.alpha_method, (0.0,)),
    "hht": (ik.alpha_method, (-0.1,)),
}
# Explicit methods with damping, the loss factor as last argument. The implicit ones have no limit
# to lose, damped or not, and are left out.
DAMPED = {"verlet": ik.verlet, "verlet, lagged damping": ik.leapfrog_lagged, "rk4": ik.rk4}
LIMITS = {"verlet": 2.0, "rk4": 2.0 * math.sqrt(2.0)}  # of w h, for a free vibration
_FREE_STEPS = 400
_RESTING_STEPS = 400


def growth_per_step(scheme: str, phase: float, loss_factor: float = 0.0) -> float:
    """Factor by which a free vibration with w h = `phase` grows in a step: the largest
    eigenvalue of the step from (q, q'/w) to the next. Hilber-Hughes-Taylor's step has an
    acceleration of its own as well; there the growth over many steps is taken. Raises ValueError
    for a loss factor above zero with a scheme that is not in `DAMPED`."""
    kernel, more = TEXTBOOK[scheme] if scheme not in DAMPED else (DAMPED[scheme], (loss_factor,))
    if loss_factor > 0.0 and scheme not in DAMPED:
        raise ValueError(f"{scheme} is not among the damped schemes {list(DAMPED)}")

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


def growth(every: int = 1) -> Iterator[tuple[str, float, float]]:
    """Scheme, w h, growth per step; `every`: take each n-th step only."""
    for scheme in TEXTBOOK:
        for phase in np.arange(0.05, 4.0, 0.05)[::every]:
            yield scheme, float(phase), growth_per_step(scheme, float(phase))


def damped_limit(scheme: str, loss_factor: float) -> float:
    """Predicted limit of w h of a free vibration with delta = loss_factor w/2.

    Central differences: 2; with lagged damping: sqrt(4 + eta^2) - eta; Runge-Kutta: where
    |1 + z + z^2/2 + z^3/6 + z^4/24| = 1 for z = w h (-eta/2 + i sqrt(1 - eta^2/4)).
    """
    if scheme == "verlet":
        return 2.0
    if scheme == "verlet, lagged damping":
        return math.sqrt(4.0 + loss_factor**2) - loss_factor
    turn = complex(-0.5 * loss_factor, math.sqrt(1.0 - 0.25 * loss_factor**2))

    def beyond(phase: float) -> float:
        z = phase * turn
        return abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))) - 1.0

    return float(brentq(beyond, 2.0, 4.0, xtol=1e-13))


def measured_limit(scheme: str, loss_factor: float) -> float:
    """The same limit from the kernel's own step: where its growth passes 1, by bisection."""
    low, high = 0.5, 4.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        # An undamped Verlet neither grows nor decays inside; rounding must not count as growth.
        if growth_per_step(scheme, middle, loss_factor) > 1.0 + 1e-9:
            high = middle
        else:
            low = middle
    return low


def damped_limits(every: int = 1) -> Iterator[tuple[str, float, float, float]]:
    """Scheme, loss factor, predicted and measured limit of w h; `every`: each n-th loss factor."""
    for scheme in DAMPED:
        for eta in np.linspace(0.0, 1.0, 11)[::every]:
            predicted = damped_limit(scheme, float(eta))
            yield scheme, float(eta), predicted, measured_limit(scheme, float(eta))


def highest_frequency_rad_s(what: Problem, penetration_m: float) -> float:
    """Of sphere and modes joined by the contact's tangent spring 1.5 s sqrt(p), rad/s.

    With a_i = q_i/sqrt(d_i), b = sqrt(m) x_s the equations are symmetric: a diagonal of w^2 and
    the spring along g = (sqrt(d), -1/sqrt(m)).
    """
    spring = 1.5 * what.spec.contact.stiffness * math.sqrt(penetration_m)
    along = np.append(np.sqrt(what.drive), -1.0 / math.sqrt(what.spec.sphere.mass_kg))
    matrix = np.diag(np.append(what.omega2, 0.0)) + spring * np.outer(along, along)
    return math.sqrt(float(np.linalg.eigvalsh(matrix)[-1]))


def contact_frequency_rad_s(what: Problem, penetration_m: float) -> float:
    """sqrt(1.5 s sqrt(p)/m), m reduced of the sphere and all modes as free masses, rad/s."""
    spring = 1.5 * what.spec.contact.stiffness * math.sqrt(penetration_m)
    return math.sqrt(spring * (1.0 / what.spec.sphere.mass_kg + float(np.sum(what.drive))))


def resting_penetration_m(what: Problem) -> float:
    """Penetration under the sphere's own weight, m."""
    weight = what.spec.sphere.mass_kg * ik.GRAVITY
    return float((weight / what.spec.contact.stiffness) ** (2.0 / 3.0))


def resting_motion(scheme: str, what: Problem, phase: float) -> float:
    """Largest motion in 400 steps of a sphere at rest on the plate that is nudged, over what the
    nudge would do on a rigid plate; `phase`: step times highest frequency of the linearised
    contact. Infinite if it blows up."""
    kernel, more = TEXTBOOK[scheme]
    depth = resting_penetration_m(what)
    modes = len(what.omega2)
    y = np.zeros(2 * modes + 2)
    y[:modes] = -what.drive / what.omega2 * what.spec.sphere.mass_kg * ik.GRAVITY
    y[2 * modes] = y[:modes].sum() - depth
    nudge = 1e-6 * depth  # small enough for the contact to stay a spring
    spring = 1.5 * what.spec.contact.stiffness * math.sqrt(depth)
    y[2 * modes + 1] = nudge * math.sqrt(spring / what.spec.sphere.mass_kg)
    gaps = np.empty(_RESTING_STEPS)
    step_s = phase / highest_frequency_rad_s(what, depth)
    kernel(y, *what.arguments, step_s, _RESTING_STEPS, 1, gaps, *more)
    moved = float(np.abs(gaps + depth).max()) / nudge
    return moved if math.isfinite(moved) else math.inf


# Energy of an impact under every scheme, over contact stiffness, sphere mass, plate speed, loss.
#
# Textbook integrators run over the impact, from a first touch at the start, a third and two thirds
# of a step (the worst counts); the energy-keeping schemes over 2000 steps, bounces included, so
# that long steps leave a plate that goes on vibrating.

WRONG = 0.01  # of the energy: its balance is lost
BLOWN = 1.0  # the energy has at least doubled
_LIMIT_HZ = 30e3  # few modes: what fails below is the contact, not the modes
_PLANTS = {"discrete_gradient": DiscreteGradientPlant, "modal": CollocationPlant}
_PLANT_STEPS = 2000
_FINE = 500  # steps a contact time
_PHASES = (0.0, 1.0 / 3.0, 2.0 / 3.0)
_SHAKEN_MODES = 10
_TEXTBOOK_SHARES = np.geomspace(2e-3, 3.0, 46)
_PLANT_SHARES = np.geomspace(1e-2, 100.0, 13)


@dataclass(frozen=True)
class Outcome:
    """Energy after an impact by one scheme at one setting.

    `where`: the map's own axis; `step`: over the rigid plate's contact time; `change`: of the
    energy, relative to that at the start (losses booked), infinite if it has blown up;
    `evaluations`: most of a contact solve, `contacts`: as the ends of the steps show them; both
    0 where not counted.
    """

    where: float
    scheme: str
    step: float
    change: float
    evaluations: int = 0
    contacts: int = 0


def few_modes(name: str = "aluminium-3mm") -> Problem:
    """A scene on the modes up to 30 kHz, without damping."""
    return problem_of(replace(problem(name, 6e-5).spec, frequency_limit_hz=_LIMIT_HZ))


def problem_of(spec: PlantSpec) -> Problem:
    """The modal equations of a description that lasts one rigid contact time."""
    limit = 2.0 * math.pi * spec.frequency_limit_hz
    modes = oscillators(spec.plate, spec.contact_point_m, spec.contact_point_m, limit)
    drive = modes.scale_per_kg * modes.contact**2
    return Problem("", spec, contact_time_s(spec), modes.omega**2, drive)


def contact_time_s(spec: PlantSpec) -> float:
    """Of the same sphere on a rigid plate, s."""
    sphere = spec.sphere
    return rigid_contact_time_s(sphere.mass_kg, spec.contact.stiffness, sphere.impact_speed_m_s)


def textbook_outcomes(
    where: float, what: Problem, contact_times: float = 2.0, plate_speed_m_s: float = 0.0,
    shares: Iterable[float] = _TEXTBOOK_SHARES,
) -> Iterator[Outcome]:  # fmt: skip
    """Every textbook integrator over `contact_times`, at least 20 steps; the plate passes its rest
    position with a speed at the struck point, shared by its lowest ten oscillators."""
    modes, lasts_s = len(what.omega2), contact_time_s(what.spec)
    for share in shares:
        step_s = float(share) * lasts_s
        steps = max(math.ceil(contact_times * lasts_s / step_s), 20)
        gaps = np.empty(steps)
        for scheme, (kernel, more) in TEXTBOOK.items():
            worst = 0.0
            for phase in _PHASES:
                y = what.start()
                y[2 * modes] = -phase * step_s * y[2 * modes + 1]
                y[modes : modes + _SHAKEN_MODES] = plate_speed_m_s / _SHAKEN_MODES
                begin = float(ik.energy(y, *what.arguments))
                with np.errstate(over="ignore", invalid="ignore"):
                    kernel(y, *what.arguments, step_s, steps, 1, gaps, *more)
                    change = float(ik.energy(y, *what.arguments)) / begin - 1.0
                worst = max(worst, change if math.isfinite(change) else math.inf, key=abs)
            yield Outcome(where, scheme, float(share), worst)


def shake(plant: Plant, speed_m_s: float) -> float:
    """Let the plate pass its rest position with a speed at the struck point, up positive, shared
    by its lowest ten oscillators. Returns the energy that this adds, J, which the plant's own
    balance do not know. For a plant at rest at the first touch."""
    body, state = plant.state.body, plant.state
    each = speed_m_s / _SHAKEN_MODES
    body[V_P] = speed_m_s
    if isinstance(plant, CollocationPlant):
        state.z[0, :_SHAKEN_MODES] = each  # z is scaled by Theta there
        body[collocation.MODAL_V] = speed_m_s
    else:
        theta = plant.model.table[plant.kernels.THETA].reshape(-1)
        state.z[0].reshape(-1)[:_SHAKEN_MODES] = each / theta[:_SHAKEN_MODES]
    state.free[:] = state.z
    return float(plant.kernels.modal_energy(plant.model, state))


def plant_outcomes(
    where: float, spec: PlantSpec, plate_speed_m_s: float = 0.0,
    shares: Iterable[float] = _PLANT_SHARES, steps: int = _PLANT_STEPS,
) -> Iterator[Outcome]:  # fmt: skip
    """The energy-keeping schemes over `steps`."""
    for share in shares:
        for scheme, make in _PLANTS.items():
            plant = make(replace(spec, step_s=float(share) * contact_time_s(spec)))
            shaken_j = shake(plant, plate_speed_m_s) if plate_speed_m_s else 0.0
            gaps = np.empty(steps)
            ik.plant_gaps(plant.model, plant.state, 1, gaps)
            balance = plant.close_balance()
            missing_j = balance.energy_residual * balance.energy_start_j - shaken_j
            touching = np.concatenate([[False], gaps < 0.0])
            yield Outcome(
                where,
                scheme,
                float(share),
                missing_j / (balance.energy_start_j + shaken_j),
                balance.newton_iterations_max,
                int(np.count_nonzero(touching[1:] & ~touching[:-1])),
            )


@cache
def contact_drift(every: int = 1) -> list[Outcome]:
    """Every scheme over one contact of the light ball against the step; `where` is 0. `every`: take
    each n-th step only."""
    what = few_modes()
    shares = np.geomspace(3e-3, 3.0, 31)[::every]
    found = list(textbook_outcomes(0.0, what, shares=shares))
    for share in shares:
        found += plant_outcomes(0.0, what.spec, shares=[share], steps=max(math.ceil(2 / share), 3))
    return found


def thesis_contact(every: int = 1) -> Iterator[tuple[float, float, float, float]]:
    """The published scheme without contact damping: step over contact time, length of its contact
    over contact time, energy and momentum residual over its first contact. Its model changes
    with the step (modes up to pi/dt), so it has no place on the other maps. `every`: take each n-th
    step only."""
    spec = few_modes().spec
    lasts_s = contact_time_s(spec)
    for share in np.geomspace(1e-2, 3.0, 16)[::every]:
        most = math.ceil(10.0 / share) + 20
        plant = ThesisPlant(replace(spec, step_s=float(share) * lasts_s), most)
        steps = 0
        while plant.state.counts[tk.TOUCHING]:
            if steps == most:
                raise ValueError(f"the contact does not end within {most} steps")
            tk.step(plant.model, plant.state, 0.0)
            steps += 1
        balance = plant.close_balance()
        length = float(share * steps)
        yield float(share), length, abs(balance.energy_residual), abs(balance.momentum_residual)


@dataclass(frozen=True)
class Predicted:
    """Limits of the explicit integrators from the contact's tangent at the deepest point of a
    finely resolved run, all modes joined. Exact for a contact that lasts; an impact of a few
    steps is wrong before and has no time to grow beyond."""

    where: float
    contact_over_highest_mode: float  # frequencies
    contact_frequency_step: float  # contact frequency times the step of one contact time
    verlet: float  # step over the rigid plate's contact time
    rk4: float


def predicted(
    where: float, spec: PlantSpec, contact_times: float = 2.0, plate_speed_m_s: float = 0.0
) -> Predicted:
    """The limits for one setting of a map."""
    what, lasts_s = problem_of(spec), contact_time_s(spec)
    fine = CollocationPlant(replace(spec, step_s=lasts_s / _FINE))
    if plate_speed_m_s:
        shake(fine, plate_speed_m_s)
    gaps = np.empty(round(contact_times * _FINE))
    ik.plant_gaps(fine.model, fine.state, 1, gaps)
    deepest = -float(gaps.min())
    contact = contact_frequency_rad_s(what, deepest)
    highest = highest_frequency_rad_s(what, deepest)
    return Predicted(
        where,
        contact / math.sqrt(float(what.omega2.max())),
        contact * lasts_s,
        LIMITS["verlet"] / (highest * lasts_s),
        LIMITS["rk4"] / (highest * lasts_s),
    )


Map = tuple[list[Predicted], list[Outcome]]


def _map(
    settings: Iterable[tuple[float, PlantSpec]], contact_times: float = 2.0,
    shares: Iterable[float] = _TEXTBOOK_SHARES, *, shaken: bool = False,
) -> Map:  # fmt: skip
    """Every scheme at every (where, spec); `shaken`: `where` is plate speed over impact speed."""
    limits: list[Predicted] = []
    found: list[Outcome] = []
    for where, spec in settings:
        speed = where * spec.sphere.impact_speed_m_s if shaken else 0.0
        limits.append(predicted(where, spec, contact_times, speed))
        found += textbook_outcomes(where, problem_of(spec), contact_times, speed, shares)
        found += plant_outcomes(where, spec, speed)
    return limits, found


def stiff(factor: float) -> PlantSpec:
    """The light ball's scene with its contact stiffness times `factor`."""
    spec = few_modes().spec
    return replace(spec, contact=replace(spec.contact, stiffness=factor * spec.contact.stiffness))


@cache
def stiffness_map(every: int = 1) -> Map:
    """Contact stiffness from 1e-5 to 1e5 of the light ball's; `every`: take each n-th only."""
    factors = np.geomspace(1e-5, 1e5, 11)[::every]
    return _map((float(factor), stiff(float(factor))) for factor in factors)


@cache
def mass_map(every: int = 1) -> Map:
    """Sphere mass over plate impedance times contact time, from spheres that hardly feel the plate
    to spheres that it can hardly stop; `every`: take each n-th only."""
    base = few_modes().spec

    def settings() -> Iterator[tuple[float, PlantSpec]]:
        for radius in np.geomspace(3e-4, 3e-2, 13)[::every]:
            sphere = replace(base.sphere, radius_m=float(radius))
            stiffness = hertz_stiffness(float(radius), sphere.material, base.plate.material)
            contact = replace(base.contact, stiffness=stiffness)
            spec = replace(base, sphere=sphere, contact=contact)
            impedance = base.simply_supported.infinite_plate_impedance_n_s_m
            yield sphere.mass_kg / (impedance * contact_time_s(spec)), spec

    return _map(settings())


@cache
def loss_map(every: int = 1) -> list[Outcome]:
    """The plate's loss factor from 0 to 1, energy-keeping schemes. The textbook integrators keep no
    account of what damping takes; their limits are in `damped_limits`. `every`: take each n-th
    loss factor only."""
    spec = few_modes().spec
    found: list[Outcome] = []
    for eta in (0.0, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0)[::every]:
        found += plant_outcomes(
            eta, replace(spec, plate=replace(spec.simply_supported, loss_factor=eta))
        )
    return found


@cache
def shaken_map(every: int = 1) -> Map:
    """The plate's speed at the struck point when the sphere arrives, over impact speed; over 20
    contact times, several bounces. The ball of 20 mm has half the mass of a mode, so that neither
    side is the other's wall. `every`: take each n-th speed only."""
    spec = few_modes("aluminium-20mm").spec
    ratios = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)[::every]
    shares = np.geomspace(1e-3, 3.0, 36)
    return _map(((ratio, spec) for ratio in ratios), 20.0, shares, shaken=True)


def border(found: Iterable[Outcome], scheme: str, least: float) -> list[tuple[float, float]]:
    """Along a map: the smallest step at which a textbook integrator's energy is off by `least`
    (from BLOWN on: too large by that), nan where none of the steps does."""
    mine = [one for one in found if one.scheme == scheme]
    edges = []
    for where in dict.fromkeys(one.where for one in mine):
        size = [(one.step, one.change) for one in mine if one.where == where]
        off = [step for step, c in size if (c if least >= BLOWN else abs(c)) >= least]
        edges.append((where, min(off, default=math.nan)))
    return edges


_MAPS: dict[str, Callable[[int], Map]] = {
    "stiffness": stiffness_map, "mass": mass_map, "shaken": shaken_map,
}  # fmt: skip
_BALANCED = ("modal", "discrete_gradient")
_TITLES = {
    "stiffness": "Contact stiffness",
    "mass": "Sphere mass against plate impedance (marks as above)",
    "shaken": "Impact on a vibrating plate (marks as above)",
}  # fmt: skip
_NAMES = {
    "stiffness": "stiffness", "mass": "sphere mass", "shaken": "plate speed", "loss": "loss factor",
}  # fmt: skip
_FLOOR = 1e-17  # below any residual but an exact zero


def draw_limits(
    path: Path,
    free: list[tuple[str, float, float]],
    damped: list[tuple[str, float, float, float]],
    contact: list[Outcome],
    thesis: list[tuple[float, float, float, float]],
    by_map: dict[str, Map],
) -> None:
    """Where the textbook integrators blow up or are wrong, with the predicted"""
    metric, axes = pictures.sheet(3, 2, width=11.0, height=4.2)
    _free(axes[0, 0], free)
    _damped(axes[0, 1], damped)
    _contact(axes[1, 0], contact, thesis)
    for axis, name in zip((axes[1, 1], axes[2, 0], axes[2, 1]), _TITLES, strict=True):
        _borders(axis, name, *by_map[name])
    pictures.save(metric, path)


def _free(axis: Any, free: list[tuple[str, float, float]]) -> None:
    for i, scheme in enumerate(TEXTBOOK):
        mine = [(x, g) for name, x, g in free if name == scheme and g < 3.0]
        axis.plot(*zip(*mine, strict=True), label=scheme, **pictures.look(i))
    for limit in LIMITS.values():
        axis.axvline(limit, color="gray", linewidth=0.8)
        axis.text(limit + 0.03, 0.62, f"{limit:.3g}", color="dimgray")
    axis.axhline(1.0, color="black", linewidth=0.8, label="modal, discrete_gradient: exact")
    axis.set(title="Free vibration", xlabel="w h", ylabel="growth per step", ylim=(0.6, 2.0))
    axis.legend(loc="upper left")


def _damped(axis: Any, damped: list[tuple[str, float, float, float]]) -> None:
    for i, scheme in zip((0, 4, 1), DAMPED, strict=True):
        mine = np.array([row[1:] for row in damped if row[0] == scheme])
        style = pictures.look(i, True)
        axis.plot(mine[:, 0], mine[:, 1], color=style["color"], linestyle=style["linestyle"])
        style |= {"linestyle": "none"}
        axis.plot(mine[:, 0], mine[:, 2], label=scheme, **style)
    axis.set(
        title="Free vibration with damping: lines predicted, marks measured", ylim=(1.0, 3.2),
        xlabel="loss factor", ylabel="largest stable w h",
    )  # fmt: skip
    axis.legend(loc="lower left")


def _contact(
    axis: Any, contact: list[Outcome], thesis: list[tuple[float, float, float, float]]
) -> None:
    for i, scheme in enumerate([*TEXTBOOK, "discrete_gradient", "modal"]):
        mine = [
            (one.step, max(abs(one.change), _FLOOR))
            for one in contact
            if one.scheme == scheme and abs(one.change) < 1e3
        ]
        axis.loglog(*zip(*mine, strict=True), label=scheme, **pictures.look(i, True))
    steps, _, energy, momentum = zip(*thesis, strict=True)
    axis.loglog(steps, energy, label="thesis2008", **pictures.look(6, True))
    axis.loglog(steps, momentum, label="thesis2008: momentum", **pictures.look(7, True))
    axis.set(
        title="One contact: energy lost or gained", xlabel="step / contact time",
        ylabel="relative", ylim=(1e-17, 1e4),
    )  # fmt: skip
    axis.legend(fontsize=7, ncols=2, loc=(0.22, 0.32))


def _borders(axis: Any, name: str, predicted: list[Predicted], found: list[Outcome]) -> None:
    """Borders of the textbook integrators; on the stiffness map in terms of the contact's
    frequency, on the others of the rigid plate's contact time."""
    stiffness = name == "stiffness"
    x = [one.contact_over_highest_mode if stiffness else one.where for one in predicted]
    unit = np.array([one.contact_frequency_step if stiffness else 1.0 for one in predicted])
    for i, scheme in enumerate(TEXTBOOK):
        style = pictures.look(i, True)
        wrong = np.array([step for _, step in border(found, scheme, WRONG)])
        axis.plot(x, wrong * unit, label=f"{scheme}: 1 % wrong", **style)
        style |= {"linestyle": "none", "markerfacecolor": "none", "markersize": 8}
        doubled = np.array([step for _, step in border(found, scheme, BLOWN)])
        axis.plot(x, doubled * unit, label=f"{scheme}: doubled", **style)
    for scheme, line in zip(LIMITS, ("-", "--"), strict=True):
        limit = np.array([getattr(one, scheme) for one in predicted])
        axis.plot(
            x, limit * unit, color="gray", linestyle=line, linewidth=2.5, alpha=0.6,
            label=f"{scheme}: predicted, {LIMITS[scheme]:.3g}",
        )  # fmt: skip
    labels = {
        "stiffness": ("contact frequency / highest mode's", "contact frequency x step"),
        "mass": ("sphere mass / (plate impedance x contact time)", "step / contact time"),
        "shaken": ("plate speed / impact speed", "step / contact time"),
    }
    axis.set(title=_TITLES[name], yscale="log", xlabel=labels[name][0], ylabel=labels[name][1])
    if name == "shaken":
        axis.set_xscale("symlog", linthresh=0.1)
        axis.set_xlim(-0.02, 150)
    else:
        axis.set_xscale("log")
    if stiffness:
        axis.legend(fontsize=7, ncols=2, loc="lower right")


def draw_energy(
    path: Path,
    outcomes: dict[str, list[Outcome]],
    latencies_us: np.ndarray,
    kappas: np.ndarray,
    plate_db: np.ndarray,
    fed_in: np.ndarray,
) -> None:
    """Energy residual and solves of the energy-keeping schemes; the closed loop, arrays of shape
    (kappas, latencies), without the first row, kappa = 0, which is no control."""
    metric, axes = pictures.sheet(2, 2, width=11.0, height=4.2)
    for j, scheme in enumerate(_BALANCED):
        for i, (name, found) in enumerate(outcomes.items()):
            mine = [one for one in found if one.scheme == scheme]
            steps = list(dict.fromkeys(one.step for one in mine))
            style = pictures.look(2 * i + j, True)
            label = f"{scheme}: {_NAMES[name]}"
            worst = [max(abs(one.change) for one in mine if one.step == step) for step in steps]
            axes[0, 0].loglog(steps, np.maximum(worst, _FLOOR), label=label, **style)
            most = [max(one.evaluations for one in mine if one.step == step) for step in steps]
            axes[0, 1].loglog(steps, most, label=label, **style)
    axes[0, 0].set(
        title="Energy residual, worst of each map", xlabel="step / contact time", ylabel="relative",
        ylim=(1e-16, 1e-6),
    )  # fmt: skip
    axes[0, 0].legend(fontsize=7, ncols=2, loc="upper left")
    axes[0, 1].set(
        title="Most evaluations of a contact solve (90 or more: modal falls back)",
        xlabel="step / contact time",
        ylabel="evaluations",
    )
    titles = ("plate energy against none (dB)", "energy fed in / impact energy")
    for axis, values, title, levels in zip(
        axes[1], (plate_db, fed_in), titles, ((0.0, 2.0, 4.0, 6.0), (0.1, 0.5, 1.0, 2.0)),
        strict=True,
    ):  # fmt: skip
        grid = latencies_us, kappas[1:], values[1:]
        shown = axis.contourf(*grid, 16, cmap="viridis")
        lines = axis.contour(*grid, levels, colors="white", linewidths=1.2)
        labels = axis.clabel(lines, fmt="%g", colors="white", fontsize=9)
        for label in labels:
            label.set_bbox({"facecolor": "black", "alpha": 0.6, "pad": 1.0, "edgecolor": "none"})
        axis.set(title=f"aluminium-3mm: {title}", xlabel="latency (us)", ylabel="kappa")
        metric.colorbar(shown, ax=axis)
    pictures.save(metric, path)


# Where methods fail: blow up, lose the energy, or let the actuator feed energy without bound.
#
# Limits of free and damped vibration (`stability_limits`), energy over stiffness, mass, plate
# speed and loss factor (`stability_maps`), and here the closed loop over gain and latency.

_KAPPAS = np.linspace(0.0, 2.0, 21)
_LATENCIES_US = np.arange(0, 61, 3)
_NEWTON = 14  # evaluations of a contact solve; with more, bisection had to step in


@dataclass(frozen=True)
class LoopPoint:
    """First impact with the law at one gain and latency: energies over the impact's energy."""

    kappa: float
    latency_us: float
    injected: float
    plate_energy_db: float  # against no control
    contact_us: float


def loop_map(name: str = "aluminium-3mm", every: int = 1) -> Iterator[LoopPoint]:
    """The slope-threshold law's first impact over gain and latency; `every`: take each n-th gain
    and latency only."""
    lasts = "run.duration_s=0.0016"
    off = load(name, [lasts, "controller.law=off"])
    free = impacts_in(off.plant, simulate(off).truth)[0]
    for kappa in _KAPPAS[::every]:
        for latency_us in _LATENCIES_US[::every]:
            keys = [f"controller.kappa={kappa:.3f}", f"controller.latency_us={latency_us}"]
            setup = load(name, [lasts, *keys])
            truth = simulate(setup)
            first = impacts_in(setup.plant, truth.truth)[0]
            yield LoopPoint(
                float(kappa),
                float(latency_us),
                truth.balance.injected_j / truth.balance.energy_start_j,
                10.0 * math.log10(first.plate_energy_j / free.plate_energy_j),
                1e6 * first.duration_s,
            )


_QUICK = 5  # each n-th point of every map


def run(folder: Path, quick: bool = False) -> tuple[dict[str, str], str]:
    """Measure all; write stability.png, stability-energy.png and a CSV file for each map.

    Steps are over the contact time of the same sphere on a rigid plate.

    Args:
        folder: folder to write into.
        quick: take each fifth point of every map; these have the values of the whole map.

    Returns:
        Key metrics to print, and the conclusion.
    """
    every = _QUICK if quick else 1
    with progress("stability", 8) as advance:
        free, damped = list(growth(every)), list(damped_limits(every))
        advance(1)
        contact = contact_drift(every)
        advance(2)
        thesis = list(thesis_contact(every))
        advance(3)
        by_map: dict[str, Map] = {}
        for done, (name, measure) in enumerate(_MAPS.items(), 4):
            by_map[name] = measure(every)
            advance(done)
        outcomes = {name: found for name, (_, found) in by_map.items()}
        outcomes["loss"] = loss_map(every)
        advance(7)
        loop = list(loop_map(every=every))
    write_rows(folder / "stability-growth.csv", ["scheme", "omega_h", "growth_per_step"], free)
    write_rows(
        folder / "stability-damped.csv",
        ["scheme", "loss_factor", "predicted_omega_h", "measured_omega_h"],
        damped,
    )
    write_records(folder / "stability-contact.csv", contact)
    write_rows(
        folder / "stability-thesis2008.csv",
        ["step", "contact_length", "energy_residual", "momentum_residual"],
        thesis,
    )
    for name, found in outcomes.items():
        write_records(folder / f"stability-{name}.csv", found)
    write_rows(
        folder / "stability-predicted.csv",
        ["map", *(field.name for field in fields(Predicted))],
        ((name, *astuple(one)) for name, (predicted, _) in by_map.items() for one in predicted),
    )
    write_records(folder / "stability-loop.csv", loop)
    draw_limits(folder / "stability.png", free, damped, contact, thesis, by_map)
    kappas, latencies_us = _KAPPAS[::every], _LATENCIES_US[::every]
    shape = (len(kappas), len(latencies_us))
    draw_energy(
        folder / "stability-energy.png", outcomes, latencies_us, kappas,
        np.array([p.plate_energy_db for p in loop]).reshape(shape),
        np.array([p.injected for p in loop]).reshape(shape),
    )  # fmt: skip
    metrics = (
        _of_limits(free, damped)
        | _of_maps(by_map)
        | _of_balance(outcomes)
        | _of_thesis(thesis)
        | _of_loop(loop)
    )
    return metrics, conclusion(outcomes, thesis)


def conclusion(
    outcomes: dict[str, list[Outcome]], thesis: list[tuple[float, float, float, float]]
) -> str:
    """How well the default scheme keeps its energy on all maps, in one sentence."""
    mine = [one for found in outcomes.values() for one in found if one.scheme == "modal"]
    worst = max(abs(one.change) for one in mine)
    return (
        f"At steps of {min(o.step for o in mine):.2g} to {max(o.step for o in mine):.3g} contact "
        f"times the energy residual of the default scheme is at most {worst:.1e}; that of the "
        f"published scheme reaches {max(row[2] for row in thesis):.2g}."
    )


def _of_limits(
    free: Iterable[tuple[str, float, float]], damped: list[tuple[str, float, float, float]]
) -> dict[str, str]:
    found = {}
    for scheme, limit in LIMITS.items():
        grows = [phase for name, phase, factor in free if name == scheme and factor > 1.0 + 1e-9]
        found[f"{scheme} grows from w h ="] = f"{min(grows):.2f} (predicted {limit:.2f})"
    for scheme in DAMPED:
        mine = [row for row in damped if row[0] == scheme]
        low, high = min(row[3] for row in mine), max(row[3] for row in mine)
        off = max(abs(row[3] - row[2]) for row in mine)
        found[f"{scheme}: limit of w h, loss factor 0 to 1"] = (
            f"{low:.2f} to {high:.2f} (off the predicted by {off:.0e})"
        )
    return found


def _range(values: Iterable[float]) -> str:
    known = [value for value in values if not math.isnan(value)]
    return f"{min(known):.2g} to {max(known):.2g}" if known else "none"


def _of_maps(by_map: dict[str, Map]) -> dict[str, str]:
    """How the textbook integrators' borders lie on the maps, steps over contact time."""
    found = {}
    for name, (predicted, outcomes) in by_map.items():
        for scheme in TEXTBOOK:
            wrong = border(outcomes, scheme, WRONG)
            doubled = border(outcomes, scheme, BLOWN)
            text = f"1 % wrong from {_range(b for _, b in wrong)} contact times"
            text += f", doubled from {_range(b for _, b in doubled)}"
            if scheme in LIMITS:
                ratios = [
                    b / getattr(one, scheme) for (_, b), one in zip(doubled, predicted, strict=True)
                ]
                text += f" ({_range(ratios)} of the predicted limit)"
            found[f"{name} map: {scheme}"] = text
    return found


def _of_balance(outcomes: dict[str, list[Outcome]]) -> dict[str, str]:
    found = {}
    for scheme in ("modal", "discrete_gradient"):
        for name, some in outcomes.items():
            mine = [one for one in some if one.scheme == scheme]
            worst = max(mine, key=lambda one: abs(one.change))
            slow = min((one.step for one in mine if one.evaluations > _NEWTON), default=math.inf)
            found[f"{scheme}, {name} map, steps of 0.01 to 100 contact times:"] = (
                f"worst energy residual {abs(worst.change):.1e}, "
                f"up to {max(one.contacts for one in mine)} contacts; "
                f"Newton's method needs help from {slow:.2g} contact times on, "
                f"{max(one.evaluations for one in mine)} evaluations at most"
            )
    return found


def _of_thesis(thesis: list[tuple[float, float, float, float]]) -> dict[str, str]:
    energy, momentum = [row[2] for row in thesis], [row[3] for row in thesis]
    lengths = [row[1] for row in thesis]
    return {
        "thesis2008, one contact, steps of 0.01 to 3 contact times:": (
            f"energy residual {_range(energy)}, momentum residual {_range(momentum)}, "
            f"contact {_range(lengths)} contact times long"
        )
    }


def _of_loop(loop: list[LoopPoint]) -> dict[str, str]:
    most = max(loop, key=lambda p: p.injected)
    better = [p for p in loop if p.plate_energy_db < -0.1]
    own = [p for p in loop if p.injected > 1.0]
    return {
        "most energy fed in by the actuator, of the impact's": (
            f"{most.injected:.2f} at kappa {most.kappa:g}, latency {most.latency_us:g} us"
        ),
        "the actuator feeds in more than the impact brought from kappa =": (
            f"{min(p.kappa for p in own):g}" if own else "none of those tried"
        ),
        "settings that take 0.1 dB or more off the plate": f"{len(better)} of {len(loop)}",
    }


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Find where each scheme and the closed loop blow up or lose their energy balance.

    Example: python -m benchmarks.stability --quick
    """
    with results_in(folder, "stability", "modal") as made:
        found, sentence = run(made, quick)
    for what, value in found.items():
        out.print(f"{what} {value}", soft_wrap=True)
    written(made, "stability.png", "stability-energy.png", "stability-*.csv")
    conclude(sentence)


if __name__ == "__main__":
    start("benchmarks.stability")
