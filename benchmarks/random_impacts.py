"""Random scenes: energy and momentum of the closed loop, and the impact against Runge-Kutta.

A scene has any of four contacts (elastic, viscous, Hunt-Crossley, yielding), a plate with modes or
without end, an actuator at the contact or elsewhere. Its loop runs with a law; then its plant
alone, on the modes without what stands for those left out, under a constant force, against
`benchmarks.integrator_kernels` at steps far shorter: error of the gap until the last contact ends,
over its largest value in contact; of the sphere's speed, over the impact speed; of the energy that
the plate has, that it lost and that the damper took, over all energy brought.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks import integrator_kernels as ik
from benchmarks.integrator_kernels import Impact
from benchmarks.model_order import random_spec, sphere_and_plate_keys
from benchmarks.program import OutDirOption, QuickOption, ScenesOption, SeedOption, median, start
from benchmarks.random_scenes import as_options, drawn, typed
from benchmarks.results import Columns, results_in
from benchmarks.scenes import load
from hertzloop.closed_loop.parts import series_under
from hertzloop.loop.simulate import simulate
from hertzloop.plant.actuator import IDEAL
from hertzloop.plant.contact.hertz import (
    rigid_contact_time_s,
    rigid_peak_force_n,
    rigid_penetration_m,
)
from hertzloop.plant.contact.yielding import yield_depth_m
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant, impedance_n_s_m
from hertzloop.plant.time_series import XI
from hertzloop.scene import setup as scenes
from hertzloop.scene.loading import shipped
from hertzloop.scene.setup import Setup

_TURN = 0.2  # of the highest mode in a step of the reference
_PARTS = 20  # of a step, at least, in the reference
_LASTS = 4.0  # times the contact on a rigid plate
_MOST_WORK = 5e7  # modes times steps of the reference: seconds
_CONTACTS = ("none", "viscous", "hunt_crossley", "thornton")


@dataclass(frozen=True)
class Outcome:
    """A scene: residuals of its loop, contact steps in which Newton did not end, and errors of its
    plant alone."""

    scene: int
    contact: str
    plate: str
    actuator: str
    request: float
    energy_residual: float
    momentum_residual: float
    contact_steps: int
    fallbacks: int
    gap: float
    speed: float
    plate_energy: float
    plate_loss: float
    damper_loss: float
    keys: str

    @property
    def error(self) -> float:
        """Largest of the errors."""
        return max(self.gap, self.speed, self.plate_energy, self.plate_loss, self.damper_loss)


def random_keys(random: np.random.Generator) -> dict[str, Any]:
    """Keys of a scene: sphere, plate, contact, law."""
    spec = random_spec(random)
    sphere, (x, y) = spec.sphere, spec.contact_point_m
    m, s, v = sphere.mass_kg, spec.contact.stiffness, sphere.impact_speed_m_s
    keys = sphere_and_plate_keys(spec) | {
        "plate.loss_factor": float(random.choice([0.0, 10.0 ** random.uniform(-4.0, -0.5)])),
        "controller.v_thr_m_s": -v * float(random.uniform(0.2, 0.8)),
        "controller.kappa": float(random.uniform(-0.5, 0.9)),
        "controller.latency_us": int(random.integers(0, 5)),
    }
    match random.choice(_CONTACTS):
        case "viscous":
            share = float(random.uniform(0.01, 0.3))
            keys["contact.viscous_n_s_m"] = share * m / rigid_contact_time_s(m, s, v)
            keys["contact.damping"] = "viscous"
        case "hunt_crossley":
            keys["contact.restitution"] = float(random.uniform(0.3, 0.9))
            keys["contact.damping"] = "hunt_crossley"
        case "thornton":
            wide = math.pi * sphere.radius_m * rigid_penetration_m(m, s, v)
            pressure = float(random.uniform(0.3, 0.9)) * rigid_peak_force_n(m, s, v) / wide
            keys["contact.limiting_pressure_pa"] = pressure
            keys["contact.plasticity"] = "thornton"
    if keys.get("contact.plasticity") != "thornton" and random.random() < 0.25:
        keys["run.plate_model"] = "infinite"
    else:
        keys["run.plate_model"] = "modal"
        if random.random() < 0.5:
            keys["plate.actuator_point_m"] = [x * float(random.uniform(0.5, 1.0)), y]
        if random.random() < 0.3:
            keys["actuator.bandwidth_hz"] = float(10.0 ** random.uniform(3.5, 5.5))
    keys["run.accuracy"] = float(random.choice([1e-2, 1e-3, 1e-4]))
    return {key: typed(value) for key, value in keys.items()}


def steps_of(setup: Setup) -> int:
    """So many steps that an impact is over on most plates."""
    sphere, contact = setup.mechanics.sphere, setup.plant.contact
    lasts_s = rigid_contact_time_s(sphere.mass_kg, contact.stiffness, sphere.impact_speed_m_s)
    return math.ceil(_LASTS * lasts_s / setup.run.step_s)


def impact_of(spec: PlantSpec, push: float) -> Impact:
    """An impact as the reference takes it."""
    modes, contact = ModalPlant(spec).modes, spec.contact
    none = np.zeros(0)
    omega, at_contact, at_actuator = modes.omega, modes.contact, modes.actuator
    mobility = 0.0
    if spec.infinite_plate:
        omega, at_contact, at_actuator = none, none, none
        mobility = 1.0 / impedance_n_s_m(spec.local_plate)
    return Impact(
        omega,
        modes.eta * omega,
        at_contact,
        at_actuator,
        modes.scale_per_kg,
        mobility,
        contact.stiffness,
        yield_depth_m(contact),
        contact.viscous_n_s_m,
        contact.hunt_crossley_s_m,
        spec.sphere.mass_kg,
        push,
    )


def errors_of(
    spec: PlantSpec, push: float, steps: int
) -> tuple[float, float, float, float, float] | None:
    """Errors of gap, speed, and the three energies; None where the reference takes too long
    or nothing touches."""
    spec = replace(spec, residual_flexibility=False, damped_residual=False, lead_in_s=0.0)
    spec = replace(spec, actuator=IDEAL)
    impact = impact_of(spec, push)
    highest = float(impact.omega[-1]) if len(impact.omega) else 0.0
    parts = max(_PARTS, math.ceil(spec.step_s * highest / _TURN))
    if parts * steps * (len(impact.omega) + 10) > _MOST_WORK:
        return None
    n, speed = len(impact.omega), spec.sphere.impact_speed_m_s
    y, gaps = np.zeros(2 * n + 5), np.empty(steps)
    y[2 * n + 1] = -speed
    ik.impact_gaps(impact, y, spec.step_s / parts, parts, gaps)
    plant = ModalPlant(spec)
    found = np.append(series_under(plant, np.full(steps, push))[XI, 1:], plant.state.body[0])
    touches = np.flatnonzero(gaps <= 0.0)
    if not touches.size:
        return None
    balance = plant.close_balance()
    brought = balance.energy_start_j + abs(balance.injected_j)
    return (
        float(np.abs(found - gaps)[: touches[-1] + 1].max() / -gaps.min()),
        abs(plant.sphere_speed_m_s() - float(y[2 * n + 1])) / speed,
        abs(balance.modal_j - float(ik.impact_energy(impact, y))) / brought,
        abs(balance.modal_dissipated_j - float(y[2 * n + 3])) / brought,
        abs(balance.contact_dissipated_j - float(y[2 * n + 4])) / brought,
    )


def outcomes(number: int, random: np.random.Generator) -> list[Outcome]:
    """The next random scene; none where the reference takes too long."""
    keys = random_keys(random)
    setup = load("aluminium-3mm").vary(keys)
    spec, steps = setup.plant, steps_of(setup)
    sphere = spec.sphere
    peak = rigid_peak_force_n(sphere.mass_kg, spec.contact.stiffness, sphere.impact_speed_m_s)
    errors = errors_of(spec, float(random.uniform(-0.2, 0.2)) * peak, steps)
    if errors is None:
        return []
    balance = simulate(
        setup.with_steps(steps + round(setup.first_touch_s / setup.run.step_s))
    ).balance
    contact = keys.get("contact.damping", keys.get("contact.plasticity", "none"))
    slow = " and slow" if "actuator.bandwidth_hz" in keys else ""
    return [
        Outcome(
            number,
            contact,
            keys["run.plate_model"],
            ("at the contact" if spec.same_point else "elsewhere") + slow,
            keys["run.accuracy"],
            balance.energy_residual,
            balance.momentum_residual,
            balance.contact_steps,
            balance.newton_fallbacks,
            *errors,
            as_options(keys),
        )
    ]


def shipped_residuals() -> list[tuple[str, float, float, int, int]]:
    """Name, energy and momentum residual, contact steps and fallbacks of the shipped scenes."""
    found = []
    for name in shipped():
        setup = scenes.load(name)
        if setup.run.scheme == "modal":
            b = simulate(setup).balance
            residuals = abs(b.energy_residual), abs(b.momentum_residual)
            found.append((name, *residuals, b.contact_steps, b.newton_fallbacks))
    return found


def main(
    folder: OutDirOption = None,
    scenes: ScenesOption = 200,
    seed: SeedOption = 1,
    quick: QuickOption = False,
) -> None:
    """Check energy, momentum and motion of random impacts.

    Example: python -m benchmarks.random_impacts --quick
    """
    with results_in(folder, "random_impacts", "modal") as results:
        named = shipped_residuals()
        found = drawn(4 if quick else scenes, seed, outcomes)
        results.write("random_impacts", found)
        columns: Columns = {
            "scene": "{[0]}",
            "energy": "{[1]:.1e}",
            "momentum": "{[2]:.1e}",
            "contact steps": "{[3]}",
            "without Newton": "{[4]}",
        }
        results.table("Shipped scenes, residuals", columns, named)
        rows = []
        for contact in _CONTACTS:
            if mine := [o for o in found if o.contact == contact]:
                over = [o.error / o.request for o in mine]
                worst = max(abs(o.energy_residual) for o in mine)
                rows.append((contact, len(mine), median(over), max(over), worst))
        columns = {
            "contact": "{[0]}",
            "scenes": "{[1]}",
            "error/asked, median": "{[2]:.1e}",
            "largest": "{[3]:.2g}",
            "energy residual": "{[4]:.1e}",
        }
        results.table("Random scenes", columns, rows)
        met = sum(o.error <= o.request for o in found)
        worst = max(abs(o.energy_residual) for o in found)
        results.conclude(
            f"{met} of {len(found)} random impacts agree with Runge-Kutta within the requested "
            f"accuracy; the largest energy residual is {worst:.1e}."
        )


if __name__ == "__main__":
    start("benchmarks.random_impacts")
