"""Plants to test with, and a plain loop that runs them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.contact.hertz import Contact, Sphere, hertz_stiffness
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.schemes.registry import step
from hertzloop.plant.state_kernels import FLIGHT_V, FLIGHT_X, V_P, XI, XI_A, XI_P, XI_S
from hertzloop.plant.structures.materials import MATERIALS, Material
from hertzloop.plant.structures.plate import Plate

# Aluminium, but so heavy and stiff that a double of the gap does not show the plate's motion.
IMMOVABLE = Material(7.2e30, 2.7e23, 0.34)


@dataclass(frozen=True)
class Rows:
    """What a run did: gaps and places at the start of every step, forces over it."""

    xi: np.ndarray
    xi_s: np.ndarray
    xi_p: np.ndarray
    v_p: np.ndarray
    xi_a: np.ndarray
    f_c: np.ndarray
    f_a: np.ndarray


def spec(
    *,
    radius_m: float = 0.003,
    drop_height_m: float = 0.05,
    material: str | Material = "aluminium",
    size_m: tuple[float, float] = (0.5, 0.5),
    thickness_m: float = 0.003,
    loss_factor: float | None = None,
    contact: Contact | None = None,
    contact_point_m: tuple[float, float] | None = None,
    actuator_point_m: tuple[float, float] | None = None,
    step_s: float = 1e-6,
    limit_hz: float = 30e3,
    lead_in_s: float = 1e-9,
) -> PlantSpec:
    """The default scene's plate and sphere with few modes, struck half a step after the start."""
    plate_material = material if isinstance(material, Material) else MATERIALS[material]
    steel = MATERIALS["steel"]
    at = contact_point_m or (size_m[0] / 2, size_m[1] / 2)
    return PlantSpec(
        sphere=Sphere(steel, radius_m, drop_height_m),
        plate=Plate(plate_material, size_m, thickness_m, loss_factor),
        contact=contact or Contact(hertz_stiffness(radius_m, steel, plate_material)),
        contact_point_m=at,
        actuator_point_m=actuator_point_m or at,
        step_s=step_s,
        frequency_limit_hz=limit_hz,
        lead_in_s=lead_in_s,
    )


def run(plant: Plant, steps: int, force: np.ndarray | None = None) -> Rows:
    """Step `plant` under the actuator forces `force` (none: zero)."""
    force = np.zeros(steps) if force is None else force
    body, places = plant.state.body, np.empty((steps, plant.state.body.size))
    contact_force = np.empty(steps)
    for i in range(steps):
        places[i] = body
        contact_force[i] = step(plant.model, plant.state, force[i])
    columns = (places[:, c] for c in (XI, XI_S, XI_P, V_P, XI_A))
    return Rows(*columns, contact_force, force[:steps])


def after_steps(plant: Plant, force: Iterable[float], places: int | list[int] = XI) -> np.ndarray:
    """The body's values at `places` after every step under the actuator forces."""
    found = []
    for push in force:
        step(plant.model, plant.state, push)
        found.append(plant.state.body[places])
    return np.array(found)


def rigid(
    step_s: float, contact: Contact, radius_m: float = 0.003, speed_m_s: float = 1.0
) -> Plant:
    """A sphere without weight, half a step before it meets an immovable support."""
    plant = ModalPlant(spec(radius_m=radius_m, material=IMMOVABLE, contact=contact, step_s=step_s))
    plant.model = plant.model._replace(gravity_m_s2=0.0)
    body = plant.state.body
    body[FLIGHT_V] = -speed_m_s
    body[[FLIGHT_X, XI, XI_S]] = 0.5 * step_s * speed_m_s
    return plant
