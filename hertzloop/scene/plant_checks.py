"""Values of sphere, plate, contact, actuator and run that are possible alone, but not together."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

from hertzloop.plant.schemes.registry import SCHEMES, schemes_where
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.scene.errors import SceneError, shortened
from hertzloop.scene.plant_tables import PlantTables
from hertzloop.scene.tables import PlateTable, Point, RunTable, SphereTable
from hertzloop.scene.unused_keys import unused_key_problems

_EDGE = 1e-4  # of a side; nearer to it a point force moves no mode by more than rounding
_MIDDLE = 0.5  # touch phase of a run that says nothing else


@lru_cache(maxsize=64)
def plant_problems(scene: PlantTables, run: RunTable) -> list[str]:
    """Of all that is neither sensor nor controller."""
    of_plate = _structure_problems(scene.plate) + _point_problems(scene.plate, scene.sensor_point_m)
    of_sphere = _sphere_problems(scene.sphere)
    if of_sphere:  # what else there is may follow from it
        return of_sphere
    of_run = _phase_problems(scene, run) + _scheme_problems(scene, run)
    return of_plate + of_run + unused_key_problems(scene)


def _sphere_problems(sphere: SphereTable) -> list[str]:
    """What a scene says of the sphere that does not make one."""
    if sphere.drop_height_m is not None and sphere.speed_m_s is not None:
        return [
            f"sphere.drop_height_m = {sphere.drop_height_m:g} and sphere.speed_m_s = "
            f"{sphere.speed_m_s:g}: both give the impact speed. Leave one out."
        ]
    if sphere.drop_height_m is sphere.speed_m_s is None:
        return ["sphere.drop_height_m: is missing from the scene. Add it, or sphere.speed_m_s."]
    given = sphere.material
    if sphere.mass_kg is not None and not isinstance(given, str):
        return [
            f"sphere.mass_kg = {sphere.mass_kg:g} and sphere.material.density_kg_m3 = "
            f"{given.density_kg_m3:g}: both give the mass. Leave out sphere.mass_kg, or name "
            "the material."
        ]
    return []


def _phase_problems(scene: PlantTables, run: RunTable) -> list[str]:
    """A touch phase of a run that does not begin in flight, or counts whole steps only."""
    if run.touch_phase == _MIDDLE:
        return []
    phase = f"run.touch_phase = {run.touch_phase!r}"
    height_m, speed_m_s = scene.sphere.drop_height_m, scene.sphere.speed_m_s
    if height_m is None:
        assert speed_m_s is not None  # see `_sphere_problems`
        height_m = speed_m_s**2 / (2.0 * GRAVITY_M_S2)
    fall_s = math.sqrt(2.0 * height_m / GRAVITY_M_S2)
    if not run.step_s <= run.lead_in_s < fall_s - run.step_s:
        return [
            f"{phase}: the run must begin in flight. Set run.lead_in_s (now {run.lead_in_s:g}) to "
            f"at least a step and less than the time to the contact, {fall_s:.3g} s."
        ]
    return []


def _point_problems(plate: PlateTable, sensor_point_m: Point | None) -> list[str]:
    found: list[str] = []
    if plate.modes is not None or plate.size_m is None:
        return found
    edges = plate.edges or "ssss"
    for key, point in (
        ("plate.contact_point_m", plate.contact_point_m),
        ("plate.actuator_point_m", plate.actuator_point_m),
        ("sensors.point_m", sensor_point_m),
    ):
        if point is None:
            continue
        shares = [p / size for p, size in zip(point, plate.size_m, strict=True)]
        if not all(0 < p < size for p, size in zip(point, plate.size_m, strict=True)):
            found.append(
                f"{key} = {list(point)} lies outside the plate. Give numbers above 0 and "
                f"below plate.size_m = {list(plate.size_m)}."
            )
        elif any(
            (share < _EDGE and low != "f") or (share > 1.0 - _EDGE and high != "f")
            for share, low, high in zip(shares, edges[::2], edges[1::2], strict=True)
        ):
            found.append(
                f"{key} = {list(point)} lies on a supported edge. Keep a distance of "
                f"{_EDGE:g} of plate.size_m = {list(plate.size_m)}."
            )
    return found


def _structure_problems(plate: PlateTable) -> list[str]:
    """What a table says of the plate that does not make one structure."""
    if plate.modes is None:
        if plate.residual_flexibility_m_n is not None:
            return [
                f"plate.residual_flexibility_m_n = {plate.residual_flexibility_m_n:g}: needs "
                "plate.modes; for a plate it is computed. Remove the key."
            ]
        return [
            f"plate.{key}: is missing from the scene. Add it."
            for key in ("size_m", "thickness_m", "contact_point_m")
            if getattr(plate, key) is None
        ]
    found = []
    if plate.edges is not None:
        found.append(
            f"plate.edges = '{plate.edges}': cannot be combined with plate.modes, which already "
            "describe the structure. Remove one of the two."
        )
    if plate.loss_factor is not None:
        found.append(
            f"plate.loss_factor = {plate.loss_factor:g}: plate.modes give a loss factor for each "
            "mode. Remove the key."
        )
    return found


def _material_words(plate: PlateTable) -> str:
    name = plate.material if isinstance(plate.material, str) else plate.material.name
    return f"plate.material = '{shortened(name)}'" if name else "the plate's material"


def check_conserves(scheme: str) -> None:
    """Raise SceneError for a scheme that keeps neither energy nor momentum, on which metrics of
    cases rest."""
    if not SCHEMES[scheme].conserves:
        raise SceneError(
            f"run.scheme = '{scheme}': not supported here. "
            f"Use {schemes_where(lambda row: row.conserves)}."
        )


class Asked(NamedTuple):
    """What a scene asks of scheme and plate model: a key, its value, and both in words."""

    what: str
    value: object
    words: str


# Keys of the actuator that belong to the line, or act with a bandwidth only.
_BESIDE_DYNAMICS = ("damping", "dead_time_us", "stuck_from_s")
# What needs no modes.
_OF_INFINITE_PLATE = (
    "run.plate_model",
    "run.touch_phase",
    "contact.damping",
    "plate.edges",
    "steps",
)


def _asked(scene: PlantTables, run: RunTable) -> Iterator[Asked]:
    """All that not every scheme and every model of the plate may have."""
    plate, contact, actuator = scene.plate, scene.contact, scene.actuator
    if run.touch_phase != _MIDDLE:
        phase = run.touch_phase
        yield Asked("run.touch_phase", phase, f"run.touch_phase = {phase!r}")
    if contact.plasticity == "thornton":
        yield Asked("contact.plasticity", "thornton", "contact.plasticity = 'thornton'")
    for key, field in type(actuator).model_fields.items():  # a later key is refused, too
        value = getattr(actuator, key)
        if key not in _BESIDE_DYNAMICS and value != field.default:
            yield Asked(f"actuator.{key}", value, f"actuator.{key} = {value:g}")
    if plate.tail == "damped":
        yield Asked("plate.tail", "damped", "plate.tail = 'damped'")
    if scene.sensor_point_m is not None:
        point = scene.sensor_point_m
        yield Asked("sensors.point_m", point, f"sensors.point_m = {list(point)}")
    if plate.modes is not None:
        yield Asked("plate.modes", plate.modes, f"plate.modes of {plate.modes.file}")
    elif plate.edges not in (None, "ssss"):
        yield Asked("plate.edges", plate.edges, f"plate.edges = '{plate.edges}'")
    place = plate.actuator_point_m
    if place is not None and place != plate.contact_point_m:
        yield Asked("plate.actuator_point_m", place, f"plate.actuator_point_m = {list(place)}")
    yield Asked("contact.damping", contact.damping, f"contact.damping = '{contact.damping}'")
    if run.plate_model == "infinite":
        yield Asked("run.plate_model", "infinite", "run.plate_model = 'infinite'")
    yield Asked("steps", run.steps, f"run.duration_s = {run.duration_s:g} ({run.steps} steps)")


def _refusals(scene: PlantTables, run: RunTable) -> Iterator[str]:
    """What the scheme refuses, and what an infinite plate does not have."""
    for what, value, words in _asked(scene, run):
        if why := SCHEMES[run.scheme].refusal(what, value):
            others = schemes_where(lambda row, what=what, value=value: row.accepts(what, value))
            other = f", or use the scheme {others}" if others else ""
            yield (
                f"{words}: not supported by run.scheme = '{run.scheme}', which {why}. "
                f"Remove or change the key{other}."
            )
        elif run.plate_model == "infinite" and what not in _OF_INFINITE_PLATE:
            yield (
                f"{words}: not supported by run.plate_model = 'infinite', which has no modes. "
                "Remove the key, or use run.plate_model = 'auto'."
            )


def _scheme_problems(scene: PlantTables, run: RunTable) -> list[str]:
    found, (contact_m, actuator_m) = [], scene.plate.points_m
    if scene.contact.plasticity == "thornton":
        plate = scene.plate_material
        pressure = scene.contact.limiting_pressure_pa
        if pressure is None and plate.hardness_pa is plate.yield_pa is None:
            found.append(
                f"contact.plasticity = 'thornton': the yield pressure of "
                f"{_material_words(scene.plate)} is unknown. Give plate.material.yield_pa, "
                "plate.material.hardness_pa or contact.limiting_pressure_pa, in Pa."
            )
    mass_kg = scene.actuator.mass_kg
    if scene.plate.tail == "damped" and mass_kg is not None and actuator_m == contact_m:
        found.append(
            f"plate.tail = 'damped': not supported with actuator.mass_kg = {mass_kg:g} at the "
            "contact point. Use 'spring' or 'auto'."
        )
    if scene.sensor_point_m is not None and scene.plate.modes is not None:
        found.append(
            f"sensors.point_m = {list(scene.sensor_point_m)}: plate.modes of "
            f"{scene.plate.modes.file} know points by their columns only. Remove the key, and give "
            "the file a column shape_sensor."
        )
    return [*_refusals(scene, run), *found]
