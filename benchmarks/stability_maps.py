"""Energy of an impact under every scheme, over contact stiffness, sphere mass, plate speed, loss.

Textbook integrators run over one impact, from a first touch at the start, a third and two thirds
of a step (the worst counts); the energy-keeping schemes over 2000 steps, bounces included, so
that long steps leave a plate that goes on vibrating.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks import integrator_kernels as ik
from benchmarks.integrators import Problem, problem
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from benchmarks.stability_limits import TEXTBOOK
from hertzloop.plant.contact.hertz import hertz_stiffness, rigid_contact_time_s
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes import thesis2008_kernels as tk
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.schemes.modal_kernels import CONTACT
from hertzloop.plant.schemes.thesis2008 import ThesisPlant
from hertzloop.plant.state_kernels import AWAKE, V_P
from hertzloop.plant.structures.linear import RE, V
from hertzloop.plant.structures.structure import oscillators

_LIMIT_HZ = 30e3  # few modes: what fails below is the contact, not the modes
_PLANTS = {"discrete_gradient": DiscreteGradientPlant, "modal": ModalPlant}
_PLANT_STEPS = 2000
_PHASES = (0.0, 1.0 / 3.0, 2.0 / 3.0)
_SHAKEN_MODES = 10
_PLANT_SHARES = np.geomspace(1e-2, 100.0, 13)


@dataclass(frozen=True)
class Outcome:
    """Energy after an impact by one scheme at one setting.

    `where`: the map's own axis; `step`: over the rigid plate's contact time; `change`: of the
    energy, relative to that at the start (losses booked), infinite if it has blown up;
    `evaluations`: most of a contact solve, `helped`: solves in which Newton's method did not end,
    `contacts`: as the ends of the steps show them; all 0 where not counted.
    """

    where: float
    scheme: str
    step: float
    change: float
    evaluations: int = 0
    helped: int = 0
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


def textbook_outcomes(what: Problem, shares: Iterable[float]) -> Iterator[Outcome]:
    """Every textbook integrator over two contact times, at least 20 steps; `where` is 0."""
    modes, lasts_s = len(what.omega2), contact_time_s(what.spec)
    for share in shares:
        step_s = float(share) * lasts_s
        steps = max(math.ceil(2.0 / share), 20)
        gaps = np.empty(steps)
        for scheme, kernel in TEXTBOOK.items():
            worst = 0.0
            for phase in _PHASES:
                y = what.start()
                y[2 * modes] = -phase * step_s * y[2 * modes + 1]
                begin = float(ik.energy(y, *what.arguments))
                with np.errstate(over="ignore", invalid="ignore"):
                    kernel(y, *what.arguments, step_s, steps, 1, gaps)
                    change = float(ik.energy(y, *what.arguments)) / begin - 1.0
                worst = max(worst, change if math.isfinite(change) else math.inf, key=abs)
            yield Outcome(0.0, scheme, float(share), worst)


def shake(plant: Plant, speed_m_s: float) -> float:
    """Let the plate pass its rest position with a speed at the contact point, up positive, shared
    by its lowest ten oscillators. Returns the energy that this adds, J, which the plant's own
    balance do not know. For a plant at rest at the first touch."""
    state, linear = plant.state, plant.model.linear
    each = linear.see[CONTACT, V, RE, :_SHAKEN_MODES]  # m/s by Re z of each
    state.z[RE, :_SHAKEN_MODES] = speed_m_s / _SHAKEN_MODES / each
    state.counts[AWAKE] = state.z.shape[1]
    state.seen[CONTACT, V] = state.body[V_P] = speed_m_s
    return float(plant.kernels.close_balance(plant.model, state))


def plant_outcomes(
    where: float,
    spec: PlantSpec,
    plate_speed_m_s: float = 0.0,
    shares: Iterable[float] = _PLANT_SHARES,
    steps: int = _PLANT_STEPS,
) -> Iterator[Outcome]:
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
                balance.newton_fallbacks,
                int(np.count_nonzero(touching[1:] & ~touching[:-1])),
            )


def contact_drift(every: int = 1) -> list[Outcome]:
    """Every scheme over one contact of the light ball against the step; `where` is 0. `every`: take
    each n-th step only."""
    what = few_modes()
    shares = np.geomspace(3e-3, 3.0, 31)[::every]
    found = list(textbook_outcomes(what, shares))
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


def stiff(factor: float) -> PlantSpec:
    """The light ball's scene with its contact stiffness times `factor`."""
    spec = few_modes().spec
    return replace(spec, contact=replace(spec.contact, stiffness=factor * spec.contact.stiffness))


def stiffness_map(every: int = 1) -> list[Outcome]:
    """Contact stiffness from 1e-5 to 1e5 of the light ball's; `every`: take each n-th only."""
    found: list[Outcome] = []
    for factor in np.geomspace(1e-5, 1e5, 11)[::every]:
        found += plant_outcomes(float(factor), stiff(float(factor)))
    return found


def mass_map(every: int = 1) -> list[Outcome]:
    """Sphere mass over plate impedance times contact time, from spheres that hardly feel the plate
    to spheres that it can hardly stop; `every`: take each n-th only."""
    base = few_modes().spec
    impedance = base.simply_supported.infinite_plate_impedance_n_s_m
    found: list[Outcome] = []
    for radius in np.geomspace(3e-4, 3e-2, 13)[::every]:
        sphere = replace(base.sphere, radius_m=float(radius))
        stiffness = hertz_stiffness(float(radius), sphere.material, base.plate.material)
        contact = replace(base.contact, stiffness=stiffness)
        spec = replace(base, sphere=sphere, contact=contact)
        found += plant_outcomes(sphere.mass_kg / (impedance * contact_time_s(spec)), spec)
    return found


def loss_map(every: int = 1) -> list[Outcome]:
    """The plate's loss factor from 0 to 1; `every`: take each n-th only."""
    spec = few_modes().spec
    found: list[Outcome] = []
    for eta in (0.0, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0)[::every]:
        plate = replace(spec.simply_supported, loss_factor=eta)
        found += plant_outcomes(eta, replace(spec, plate=plate))
    return found


def shaken_map(every: int = 1) -> list[Outcome]:
    """The plate's speed at the contact point when the sphere arrives, over impact speed. The ball
    of 20 mm has half the mass of a mode, so that neither side is the other's wall. `every`: take
    each n-th speed only."""
    spec = few_modes("aluminium-20mm").spec
    found: list[Outcome] = []
    for ratio in (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)[::every]:
        found += plant_outcomes(ratio, spec, ratio * spec.sphere.impact_speed_m_s)
    return found
