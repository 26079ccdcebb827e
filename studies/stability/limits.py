"""Stability limits of the textbook integrators: predicted, and found by running their kernels.

Free vibration with and without damping; and a sphere at rest on the plate, where the contact is a
spring for as long as one likes, so that the limit of the linearised equations holds exactly.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import brentq

from plant.contact.hertz import hertz_stiffness, rigid_contact_time_s
from plant.plant import Plant, PlantSpec
from plant.schemes import collocation_kernels as collocation
from plant.schemes import thesis2008_kernels as tk
from plant.schemes.collocation import CollocationPlant
from plant.schemes.discrete_gradient import DiscreteGradientPlant
from plant.schemes.thesis2008 import ThesisPlant
from plant.state_kernels import V_P
from plant.structures.structure import oscillators
from studies.speed_accuracy import integrator_kernels as ik
from studies.speed_accuracy.cases import Problem, problem

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


def growth() -> Iterator[tuple[str, float, float]]:
    """Scheme, w h, growth per step."""
    for scheme in TEXTBOOK:
        for phase in np.arange(0.05, 4.0, 0.05):
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


def damped_limits() -> Iterator[tuple[str, float, float, float]]:
    """Scheme, loss factor, predicted and measured limit of w h."""
    for scheme in DAMPED:
        for eta in np.linspace(0.0, 1.0, 11):
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
    books do not know. For a plant at rest at the first touch."""
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
            books = plant.close_balance()
            missing_j = books.energy_residual * books.energy_start_j - shaken_j
            touching = np.concatenate([[False], gaps < 0.0])
            yield Outcome(
                where,
                scheme,
                float(share),
                missing_j / (books.energy_start_j + shaken_j),
                books.newton_iterations_max,
                int(np.count_nonzero(touching[1:] & ~touching[:-1])),
            )


@cache
def contact_drift() -> list[Outcome]:
    """Every scheme over one contact of the light ball against the step; `where` is 0."""
    what = few_modes()
    shares = np.geomspace(3e-3, 3.0, 31)
    found = list(textbook_outcomes(0.0, what, shares=shares))
    for share in shares:
        found += plant_outcomes(0.0, what.spec, shares=[share], steps=max(math.ceil(2 / share), 3))
    return found


def thesis_contact() -> Iterator[tuple[float, float, float, float]]:
    """The published scheme without contact damping: step over contact time, length of its contact
    over contact time, energy and momentum residual over its first contact. Its model changes
    with the step (modes up to pi/dt), so it has no place on the other maps."""
    spec = few_modes().spec
    lasts_s = contact_time_s(spec)
    for share in np.geomspace(1e-2, 3.0, 16):
        most = math.ceil(10.0 / share) + 20
        plant = ThesisPlant(replace(spec, step_s=float(share) * lasts_s), most)
        steps = 0
        while plant.state.counts[tk.TOUCHING]:
            if steps == most:
                raise ValueError(f"the contact does not end within {most} steps")
            tk.step(plant.model, plant.state, 0.0)
            steps += 1
        books = plant.close_balance()
        length = float(share * steps)
        yield float(share), length, abs(books.energy_residual), abs(books.momentum_residual)


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
def stiffness_map() -> Map:
    """Contact stiffness from 1e-5 to 1e5 of the light ball's."""
    return _map((float(factor), stiff(float(factor))) for factor in np.geomspace(1e-5, 1e5, 11))


@cache
def mass_map() -> Map:
    """Sphere mass over plate impedance times contact time, from spheres that hardly feel the plate
    to spheres that it can hardly stop."""
    base = few_modes().spec

    def settings() -> Iterator[tuple[float, PlantSpec]]:
        for radius in np.geomspace(3e-4, 3e-2, 13):
            sphere = replace(base.sphere, radius_m=float(radius))
            stiffness = hertz_stiffness(float(radius), sphere.material, base.plate.material)
            contact = replace(base.contact, stiffness=stiffness)
            spec = replace(base, sphere=sphere, contact=contact)
            impedance = base.simply_supported.infinite_plate_impedance_n_s_m
            yield sphere.mass_kg / (impedance * contact_time_s(spec)), spec

    return _map(settings())


@cache
def loss_map() -> list[Outcome]:
    """The plate's loss factor from 0 to 1, energy-keeping schemes. The textbook integrators keep no
    account of what damping takes; their limits are in `stability_limits.damped_limits`."""
    spec = few_modes().spec
    found: list[Outcome] = []
    for eta in (0.0, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0):
        found += plant_outcomes(
            eta, replace(spec, plate=replace(spec.simply_supported, loss_factor=eta))
        )
    return found


@cache
def shaken_map() -> Map:
    """The plate's speed at the struck point when the sphere arrives, over impact speed; over 20
    contact times, several bounces. The ball of 20 mm has half the mass of a mode, so that neither
    side is the other's wall."""
    spec = few_modes("aluminium-20mm").spec
    ratios = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
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
