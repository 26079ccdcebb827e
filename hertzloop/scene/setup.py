"""A run in SI units: everything that follows from a scene before anything runs.

`resolve` reads a scene from top to bottom. Each step is a function of the tables and numbers that
it needs, in a file of its own, and keeps its latest results by these. So setups that differ in one
key share what does not depend on that key.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from hertzloop.controller.controller import SignalPath
from hertzloop.controller.law import LawContext
from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.plant.estimates import model_order
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.scene.controller_table import ControllerTable
from hertzloop.scene.errors import SceneError
from hertzloop.scene.infinite_plate import InfinitePlate
from hertzloop.scene.law_context import law_force_bound, resolve_law_context
from hertzloop.scene.loading import load as load_scene
from hertzloop.scene.loading import parse as parse_scene
from hertzloop.scene.mechanics import Mechanics, resolve_mechanics
from hertzloop.scene.plate_model import check_modes, describe_plant, on_infinite_plate
from hertzloop.scene.scene import Scene
from hertzloop.scene.sensor import resolve_sensor
from hertzloop.scene.signal_path import keeps_force_smooth, resolve_signal_path
from hertzloop.scene.tables import RunTable, SensorsTable
from hertzloop.scene.varying import resolution_of
from hertzloop.scene.varying import vary as vary_scene
from hertzloop.sensors.acquisition import SensorSpec

_MATERIAL_KEYS = {"young_pa": "youngs_modulus_pa", "poisson": "poisson_ratio"}
_PLAIN_SENSORS, _NO_CONTROL = SensorsTable(quantity="xi"), ControllerTable(law=NO_CONTROL)


@dataclass(frozen=True)
class Setup:
    """A run in SI units, resolved from a scene by `resolve`: the scene and what follows from it.

    Two setups are equal if their scenes are, and if their laws know the same of the run.
    """

    scene: Scene
    run: RunTable = field(compare=False)
    """length, step, scheme and seed, as the scene says"""
    mechanics: Mechanics = field(compare=False)
    """what collides"""
    plant: PlantSpec = field(compare=False)
    """the plant with the model of the plate that `run.plate_model` comes to"""
    sensor: SensorSpec = field(compare=False)
    signal_path: SignalPath = field(compare=False)
    law_context: LawContext
    """what a law may know without a simulation"""
    infinite_plate: InfinitePlate = field(compare=False)
    """an infinite plate in the place of the modes, whether or not it is used"""

    def __reduce__(self) -> tuple[Any, ...]:
        """The scene alone travels to other processes: a law may hold compiled code."""
        return resolve, (self.scene, self.law_context.stiffness)

    @property
    def first_touch_s(self) -> float:
        """When the sphere first touches the structure, from the start of the run, s."""
        return _first_touch_s(self.run, self.mechanics)

    @property
    def plate_model(self) -> str:
        """Model of the plate, "modal" or "infinite", that `run.plate_model` comes to."""
        return "infinite" if self.plant.infinite_plate else "modal"

    @property
    def latency_us(self) -> float:
        """Latency beyond the one step that cannot be avoided, us; of a trace, the least."""
        return _latency_us(self.run, self.signal_path)

    @property
    def expected_error(self) -> float:
        """The relative error of penetration or plate energy that leaving out modes, or the
        reflections, is expected to cost; under a law at least what the steps of its force do."""
        spec = self.plant
        if spec.infinite_plate:
            return self.infinite_plate.error(self.run.duration_s - self.first_touch_s)
        found = model_order.expected_error(
            spec.sphere,
            spec.plate,
            spec.contact,
            spec.frequency_limit_hz,
            spring=spec.residual_flexibility,
            damped=spec.damped_residual,
        )
        if not spec.residual_flexibility or spec.frequency_limit_hz == 0.0:  # a rigid body
            return found
        bound = self.infinite_plate.force_bound
        hold_s = self.run.step_s * self.sensor.every_steps
        return max(found, model_order.law_error(spec, bound.force_n, bound.share, hold_s))

    def value_of(self, key: str) -> Any:
        """Return the value of "table.key" in the unit of the key; None if there is none.

        A limiting pressure, a loss factor and properties of a material may follow from other keys.
        """
        table, _, last = key.partition(".")
        if key == "contact.limiting_pressure_pa" and self.mechanics.contact.limit is not None:
            return self.mechanics.contact.limit.pressure_pa
        if key == "plate.loss_factor":
            plate = self.mechanics.structure.local_plate
            return None if plate is None else plate.eta
        if key == "contact.stiffness_factor":
            return self.scene.contact.stiffness_factor or 1.0
        if table in ("plate", "sphere") and last.startswith("material."):
            tables, name = self.scene.plant_tables, last.partition(".")[2]
            material = tables.plate_material if table == "plate" else tables.sphere_material
            return getattr(material, _MATERIAL_KEYS.get(name, name), None)
        return getattr(getattr(self.scene, table, None), last, None)

    # Other setups.

    def vary(self, values: Mapping[str, Any]) -> "Setup":
        """Return the setup with other values of some scene keys, "table.key": value. Raises
        SceneError."""
        return resolve(vary_scene(self.scene, values))

    def resolution_of(self, key: str) -> float:
        """Return how far apart the values of a scene key are; see `scene.varying`."""
        return resolution_of(self.scene, key)

    def refusal(self, values: Mapping[str, Any]) -> str:
        """Return why the scene cannot have these values, in a sentence; "" if it can."""
        try:
            vary_scene(self.scene, values)
        except SceneError as error:
            return str(error)
        return ""

    def without_control(self, *, same_plate: bool = False) -> "Setup":
        """Return the setup with the law switched off; with `same_plate` on the model of the plate
        that this setup has, which is otherwise chosen anew."""
        scene = self.with_plate_model(self.plate_model).scene if same_plate else self.scene
        return resolve(scene.without_control())

    def with_plate_model(self, plate_model: str) -> "Setup":
        """Return the setup with `run.plate_model` set."""
        if plate_model == self.plate_model and not self.plant.infinite_plate:
            # Nothing but the word changes; without an infinite plate the contact could yield.
            run = self.run.replaced(plate_model=plate_model)
            return replace(self, scene=self.scene.replaced(run=run), run=run)
        return self._with_run(plate_model=plate_model)

    def with_steps(self, steps: int) -> "Setup":
        """Return the setup with a run of so many steps."""
        return self._with_run(duration_s=steps * self.run.step_s)

    def with_stiffness(self, stiffness: float) -> "Setup":
        """Return the setup with the stiffness, N/m^1.5, that the plant of a run announced: on
        another processor its last digit may differ from ours."""
        return resolve(self.scene, stiffness)

    def plant_only(self) -> Scene:
        """Return the scene without control, converters, seed and names: the same for all setups
        whose plant alone behaves in the same way."""
        run = self.run.replaced(seed=0, touch_phase=self.run.phase)
        plain = {"name": "plain", "shows": "", "fit": None, "run": run}
        return self.scene.replaced(sensors=_PLAIN_SENSORS, controller=_NO_CONTROL, **plain)

    def _with_run(self, **values: Any) -> "Setup":
        return resolve(self.scene.replaced(run=self.run.replaced(**values)))


Resolvable = Scene | Setup  # what a user may hand over


def resolve(scene: Resolvable, announced_stiffness: float | None = None) -> Setup:
    """Return the setup of a scene.

    Args:
        scene: a scene; a setup is returned as it is.
        announced_stiffness: contact stiffness that the plant of a run announced, N/m^1.5.

    Raises:
        SceneError: the scene cannot be run.
    """
    if isinstance(scene, Setup):
        return scene
    run, sensors = scene.run, scene.sensors
    knows_yield = (
        SCHEMES[run.scheme].accepts("contact.plasticity", "thornton")
        and run.plate_model != "infinite"
    )
    mechanics = resolve_mechanics(scene.plant_tables, knows_yield)
    path = resolve_signal_path(scene.controller, scene.actuator, sensors.every_steps, run)
    plant = describe_plant(
        mechanics, scene.plate.tail, run.scheme, run.step_ns, run.lead_in_s, run.accuracy
    )
    sensor = resolve_sensor(sensors, mechanics, run.step_s, _latency_us(run, path))
    infinite = InfinitePlate(
        mechanics=mechanics,
        scheme=run.scheme,
        step_s=run.step_s,
        accuracy=run.accuracy,
        force_bound=law_force_bound(scene.controller),
        smooth=keeps_force_smooth(sensor, path),
        latency_s=1e-6 * _latency_us(run, path),
    )
    if _is_infinite(run, infinite, run.duration_s - _first_touch_s(run, mechanics)):
        plant = on_infinite_plate(plant, run.step_ns)
    else:
        plant = check_modes(plant, run.step_ns, run.scheme, run.accuracy)
    stiffness = announced_stiffness or mechanics.contact.stiffness
    known = resolve_law_context(mechanics, stiffness, path, sensor, run.step_ns)
    return Setup(scene, run, mechanics, plant, sensor, path, known, infinite)


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Setup:
    """Read a scene by shipped name or from a file, and resolve it. See `scene.loading.load`."""
    return resolve(load_scene(source, settings, seed))


def parse(text: str, settings: Iterable[str] = (), **more: Any) -> Setup:
    """Read a scene from TOML text, and resolve it. See `scene.loading.parse`."""
    return resolve(parse_scene(text, settings, **more))


def _is_infinite(run: RunTable, infinite: InfinitePlate, until_s: float) -> bool:
    """Whether `run.plate_model` comes to an infinite plate for a time after the first touch, s."""
    if run.plate_model != "auto":
        return run.plate_model == "infinite"
    return infinite.error(until_s) <= run.accuracy


def _first_touch_s(run: RunTable, mechanics: Mechanics) -> float:
    return min(run.lead_in_s, mechanics.sphere.impact_speed_m_s / GRAVITY_M_S2)


def _latency_us(run: RunTable, path: SignalPath) -> float:
    return path.latency_steps * run.step_ns / 1000
