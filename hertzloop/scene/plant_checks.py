"""Values of sphere, plate, contact, actuator and run that are possible alone, but not together."""

import math
from functools import lru_cache

from hertzloop.plant.schemes.registry import SCHEMES, supporting
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
    if refusal := not_supported("supports_touch_phase", run.scheme, "modal", phase):
        return refusal
    if not run.step_s <= run.lead_in_s < fall_s - run.step_s:
        return [
            f"{phase}: the run must begin in flight. Set run.lead_in_s (now {run.lead_in_s:g}) to "
            f"at least a step and less than the time to the contact, {fall_s:.3g} s."
        ]
    return []


def _sensor_problems(scene: PlantTables, run: RunTable) -> list[str]:
    """What does not go with a sensor elsewhere."""
    point = scene.sensor_point_m
    if point is None:
        return []
    asked = f"sensors.point_m = {list(point)}"
    found = not_supported("supports_sensor_elsewhere", run.scheme, run.plate_model, asked)
    if scene.plate.modes is not None:
        found.append(
            f"sensors.point_m = {list(point)}: plate.modes of {scene.plate.modes.file} know points "
            "by their columns only. Remove the key, and give the file a column shape_sensor."
        )
    return found


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


def _beyond_simply_supported(scene: PlantTables, run: RunTable) -> list[str]:
    """What is known of a simply supported plate only."""
    plate, found = scene.plate, []
    if plate.modes is not None:
        key, words = "plate.modes", f"plate.modes of {plate.modes.file}"
    elif plate.edges not in (None, "ssss"):
        key, words = "plate.edges", f"plate.edges = '{plate.edges}'"
    else:
        return []
    if not SCHEMES[run.scheme].supports_edges:
        found.append(
            f"{words}: run.scheme = '{run.scheme}' supports a simply supported plate only. "
            f"Remove {key}, or use the scheme {supporting('supports_edges')}."
        )
    if run.plate_model == "infinite" and plate.modes is not None:
        found.append(
            f"{words}: run.plate_model = 'infinite' has no modes. Use run.plate_model = 'auto'."
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
            f"run.scheme = '{scheme}': not supported here. Use {supporting('conserves')}."
        )


def not_supported(capability: str, scheme: str, plate_model: str, key: str) -> list[str]:
    """The sentence on a key that needs a capability of the scheme, and modes."""
    if not getattr(SCHEMES[scheme], capability):
        return [
            f"{key}: not supported by run.scheme = '{scheme}'. Remove the key, or use the scheme "
            f"{supporting(capability)}."
        ]
    if plate_model == "infinite":
        return [
            f"{key}: not supported by run.plate_model = 'infinite'. Remove the key, or use "
            "run.plate_model = 'auto'."
        ]
    return []


def _truncation_problems(scene: PlantTables, run: RunTable) -> list[str]:
    """Where the modes left out are no damped mode."""
    if scene.plate.tail != "damped":
        return []
    asked, (contact, actuator) = "plate.tail = 'damped'", scene.plate.points_m
    if scene.actuator.mass_kg is not None and actuator == contact:
        return [
            f"{asked}: not supported with actuator.mass_kg = {scene.actuator.mass_kg:g} at the "
            "contact point. Use 'spring' or 'auto'."
        ]
    return not_supported("supports_truncated_modes", run.scheme, run.plate_model, asked)


# Keys of the actuator that belong to the line, or act with a bandwidth only.
_BESIDE_DYNAMICS = ("damping", "dead_time_us", "stuck_from_s")


def _scheme_problems(scene: PlantTables, run: RunTable) -> list[str]:
    found: list[str] = []
    contact, scheme = scene.contact, SCHEMES[run.scheme]

    def needs(capability: str, key: str) -> list[str]:
        return not_supported(capability, run.scheme, run.plate_model, key)

    if contact.plasticity == "thornton":
        found += needs("supports_yield", f"contact.plasticity = '{contact.plasticity}'")
        plate = scene.plate_material
        if contact.limiting_pressure_pa is None and plate.hardness_pa is plate.yield_pa is None:
            found.append(
                f"contact.plasticity = '{contact.plasticity}': the yield pressure of "
                f"{_material_words(scene.plate)} is unknown. Give plate.material.yield_pa, "
                "plate.material.hardness_pa or contact.limiting_pressure_pa, in Pa."
            )
    for key, field in type(scene.actuator).model_fields.items():  # a later key is refused, too
        value = getattr(scene.actuator, key)
        if key not in _BESIDE_DYNAMICS and value != field.default:
            found += needs("supports_actuator_dynamics", f"actuator.{key} = {value:g}")
    found += _truncation_problems(scene, run) + _sensor_problems(scene, run)
    point = scene.plate.actuator_point_m
    found += _beyond_simply_supported(scene, run)
    apart = point is not None and point != scene.plate.contact_point_m
    if run.plate_model == "infinite":
        if not scheme.supports_infinite_plate:
            found.append(
                f"run.plate_model = 'infinite': not supported by run.scheme = '{run.scheme}'. Use "
                f"the scheme {supporting('supports_infinite_plate')}, or plate_model 'auto'."
            )
        if apart:
            found.append(
                f"plate.actuator_point_m = {list(point or ())} needs modes, which run.plate_model "
                "= 'infinite' does not have. Remove the key, or use plate_model 'auto'."
            )
    if contact.damping not in scheme.dampings:
        known = ", ".join(f"'{name}'" for name in sorted(scheme.dampings))
        others = [f"'{name}'" for name, row in SCHEMES.items() if contact.damping in row.dampings]
        found.append(
            f"contact.damping = '{contact.damping}': not supported by run.scheme = '{run.scheme}'. "
            f"Use one of {known}, or the scheme {' or '.join(others)}."
        )
    if apart and not scheme.supports_separate_actuator:
        found.append(
            f"plate.actuator_point_m = {list(point or ())} is not supported by run.scheme = "
            f"'{run.scheme}'. Remove the key, or use the scheme "
            f"{supporting('supports_separate_actuator')}."
        )
    if scheme.most_steps is not None and run.steps > scheme.most_steps:
        found.append(
            f"run.duration_s = {run.duration_s:g} gives {run.steps} steps; run.scheme = "
            f"'{run.scheme}' supports at most {scheme.most_steps}. Reduce the duration."
        )
    return found
