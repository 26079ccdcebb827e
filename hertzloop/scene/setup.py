"""A run in SI units: everything that follows from a scene before anything runs.

`resolve` reads a scene from top to bottom. Each step is a function of the tables and numbers that
it needs, in a file of its own, and keeps its latest results by these. So setups that differ in one
key share what does not depend on that key.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.controller.controller import SignalPath
from hertzloop.controller.law import ForceBound, LawContext
from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant.actuator import Actuator
from hertzloop.plant.contact.hertz import Contact, Sphere
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.structure import Structure
from hertzloop.scene.controller_table import ControllerTable
from hertzloop.scene.errors import SceneError
from hertzloop.scene.infinite_plate import InfinitePlate
from hertzloop.scene.law_context import about_mechanics, law_force_bound
from hertzloop.scene.loading import load as load_scene
from hertzloop.scene.loading import parse as parse_scene
from hertzloop.scene.mechanics import Mechanics, resolve_mechanics
from hertzloop.scene.plant_tables import PlantTables
from hertzloop.scene.plate_model import check_modes, describe_plant, on_infinite_plate
from hertzloop.scene.scene import Scene
from hertzloop.scene.sensor import resolve_sensor
from hertzloop.scene.signal_path import keeps_force_smooth, resolve_line
from hertzloop.scene.tables import MaterialKey, RunTable, SensorsTable
from hertzloop.scene.varying import resolution_of
from hertzloop.scene.varying import vary as vary_scene
from hertzloop.sensors.acquisition import SensorSpec

PHASE_STREAM = 4  # random stream of the touch phase; sensor and controller have others
_PLAIN_SENSORS, _NO_CONTROL = SensorsTable(quantity="xi"), ControllerTable(law=NO_CONTROL)


@dataclass(frozen=True)
class Setup:
    """A run in SI units, resolved from a scene by `resolve`.

    Two setups are equal if their scenes are, and if the plant announced the same stiffness.
    """

    scene: Scene
    announced_stiffness: float | None
    """contact stiffness that the plant of a run announced, N/m^1.5; the law then works with it. On
    another processor its last digit may differ from ours"""
    touch_phase: float = field(compare=False)
    """part of a step from the last sample above the plate to the first touch"""
    first_touch_s: float = field(compare=False)
    """when the sphere first touches the structure, from the start of the run, s"""
    mechanics: Mechanics = field(compare=False)
    line: SignalPath = field(compare=False)
    latency_us: float = field(compare=False)
    """of the line beyond the one step that cannot be avoided, us; of a trace, the least"""
    force_bound: ForceBound = field(compare=False)
    """bound on the law's force"""
    with_edges: PlantSpec = field(compare=False)
    """the plant with modes, whether or not these are used"""
    infinite_plate: InfinitePlate = field(compare=False)
    """an infinite plate in the place of the modes, whether or not it is used"""
    plate_model: str = field(compare=False)
    """model of the plate, "modal" or "infinite", that `run.plate_model` comes to"""
    plant: PlantSpec = field(compare=False)
    sensor: SensorSpec = field(compare=False)
    about_mechanics: LawContext = field(compare=False)
    """what a law may know without a simulation and without the range of the converter"""

    def __reduce__(self) -> tuple[Any, ...]:
        """The scene alone travels to other processes: a law may hold compiled code."""
        return resolve, (self.scene, self.announced_stiffness)

    # What the scene says in numbers.

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.name

    @property
    def step_ns(self) -> int:
        """Length of a step, ns."""
        return self.scene.run.step_ns

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return self.scene.run.step_s

    @property
    def steps(self) -> int:
        """Length of the run in steps."""
        return self.scene.run.steps

    @property
    def duration_s(self) -> float:
        """Length of the run, s."""
        return self.scene.run.duration_s

    @property
    def lead_in_s(self) -> float:
        """Flight before the first contact, s."""
        return self.scene.run.lead_in_s

    @property
    def accuracy(self) -> float:
        """Relative error that the choice of the plate's model may cause."""
        return self.scene.run.accuracy

    @property
    def seed(self) -> int:
        """Seed of noise, jitter, drop-outs and a random touch phase."""
        return self.scene.run.seed

    @property
    def scheme(self) -> str:
        """Numerical scheme, a key of SCHEMES."""
        return self.scene.run.scheme

    @property
    def quantity(self) -> str:
        """Sampled quantity, a key of SENSED."""
        return self.scene.sensors.quantity

    @property
    def every_steps(self) -> int:
        """Steps between two samples."""
        return self.scene.sensors.every_steps

    @property
    def size_m(self) -> tuple[float, float] | None:
        """Length and width of the plate, m; None where modes stand for it."""
        return self.scene.plate.size_m

    @property
    def law_reference(self) -> str:
        """The law as the scene names it: a shipped name, a file, or a module."""
        return self.scene.controller.law

    @property
    def has_law(self) -> bool:
        """Whether there is control at all."""
        return self.scene.controller.law != NO_CONTROL

    @property
    def law_is_shipped(self) -> bool:
        """Whether the law comes with hertzloop."""
        return self.scene.controller.law in shipped_laws()

    @property
    def plate_material(self) -> str:
        """Name of the plate's material; "" for numbers without a name."""
        return _name(self.scene.plate.material)

    @property
    def sphere_material(self) -> str:
        """Name of the sphere's material; "" for numbers without a name."""
        return _name(self.scene.sphere.material)

    # What collides, and the sensor.

    @property
    def sphere(self) -> Sphere:
        """The sphere."""
        return self.mechanics.sphere

    @property
    def structure(self) -> Structure:
        """The plate, or the structure that a file of modes describes."""
        return self.mechanics.structure

    @property
    def contact(self) -> Contact:
        """The contact."""
        return self.mechanics.contact

    @property
    def actuator(self) -> Actuator:
        """The actuator."""
        return self.mechanics.actuator

    @property
    def stiffness(self) -> float:
        """Contact stiffness that the law works with, N/m^1.5."""
        return self.announced_stiffness or self.contact.stiffness

    @property
    def converter_step(self) -> float:
        """Distance of two levels of the sensor's converter; zero of an ideal one."""
        return self.sensor.converter_step

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
        if not same_plate:
            return resolve(self.scene.without_control())
        if not self.has_law:
            return self
        return resolve(self._scene_with_run("plate_model", self.plate_model).without_control())

    def with_plate_model(self, plate_model: str) -> "Setup":
        """Return the setup with `run.plate_model` set."""
        scene = self._scene_with_run("plate_model", plate_model)
        alike = plate_model == self.plate_model and self.announced_stiffness is None
        if not alike or (plate_model == "infinite" != self.scene.run.plate_model):
            return resolve(scene)
        return replace(self, scene=scene)  # "auto" came to it: nothing else differs

    def with_steps(self, steps: int) -> "Setup":
        """Return the setup with a run of so many steps."""
        return resolve(self._scene_with_run("duration_s", steps * self.step_s))

    def with_stiffness(self, stiffness: float) -> "Setup":
        """Return the setup with the stiffness, N/m^1.5, that the plant of a run announced."""
        return resolve(self.scene, stiffness)

    def with_name(self, name: str) -> "Setup":
        """Return the same setup under another name."""
        return resolve(self.scene.replaced(name=name))

    def plant_only(self) -> "Setup":
        """Return the setup without control, converters, seed and names: the same for all setups
        whose plant alone behaves in the same way."""
        tables = self.scene.plant_tables._replace(sensor_point_m=None)
        return _plant_only(tables, self.scene.run, self.touch_phase)

    def _scene_with_run(self, key: str, value: str | float) -> Scene:
        return self.scene.replaced(run=_run_with(self.scene.run, key, value))


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
    run, control, sensors = scene.run, scene.controller, scene.sensors
    knows_yield = SCHEMES[run.scheme].supports_yield and run.plate_model != "infinite"
    mechanics = resolve_mechanics(scene.plant_tables, run.accuracy, knows_yield)
    first_touch_s = _first_touch_s(run, mechanics.sphere)

    line = resolve_line(control, scene.actuator, sensors.every_steps, run.step_ns)
    latency_us = control.latency_us
    if control.latency_trace is not None:
        latency_us = line.latency_steps * run.step_ns / 1000
    force_bound = law_force_bound(control)

    with_edges = describe_plant(
        mechanics,
        scene.plate.tail,
        run.scheme,
        run.step_ns,
        run.lead_in_s,
        run.accuracy,
    )
    infinite_plate = InfinitePlate(
        mechanics=mechanics,
        scheme=run.scheme,
        step_s=run.step_s,
        accuracy=run.accuracy,
        force_bound=force_bound,
        smooth=keeps_force_smooth(control, sensors, line),
        latency_s=1e-6 * latency_us,
    )
    until_s = run.duration_s - first_touch_s
    plate_model, plant = _choose_plate_model(run, infinite_plate, with_edges, until_s)

    stiffness = announced_stiffness or mechanics.contact.stiffness
    return Setup(
        scene=scene,
        announced_stiffness=announced_stiffness,
        touch_phase=_touch_phase(run),
        first_touch_s=first_touch_s,
        mechanics=mechanics,
        line=line,
        latency_us=latency_us,
        force_bound=force_bound,
        with_edges=with_edges,
        infinite_plate=infinite_plate,
        plate_model=plate_model,
        plant=plant,
        sensor=resolve_sensor(sensors, mechanics, run.step_s, latency_us),
        about_mechanics=about_mechanics(
            mechanics, stiffness, line, run.step_ns, sensors.every_steps
        ),
    )


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Setup:
    """Read a scene by shipped name or from a file, and resolve it. See `scene.loading.load`."""
    return resolve(load_scene(source, settings, seed))


def parse(text: str, settings: Iterable[str] = (), **more: Any) -> Setup:
    """Read a scene from TOML text, and resolve it. See `scene.loading.parse`."""
    return resolve(parse_scene(text, settings, **more))


def _choose_plate_model(
    run: RunTable, infinite_plate: InfinitePlate, with_edges: PlantSpec, until_s: float
) -> tuple[str, PlantSpec]:
    """Return the model of the plate that `run.plate_model` comes to, and the plant with it;
    `until_s`: length of the run from the first touch on, s. Raises SceneError."""
    plate_model = run.plate_model
    if plate_model == "auto":
        is_enough = infinite_plate.error(until_s) <= run.accuracy
        plate_model = "infinite" if is_enough else "modal"
    if plate_model == "infinite":
        return plate_model, on_infinite_plate(with_edges, run.step_ns)
    return plate_model, check_modes(with_edges, run.step_ns, run.scheme, run.accuracy)


def _first_touch_s(run: RunTable, sphere: Sphere) -> float:
    return min(run.lead_in_s, sphere.impact_speed_m_s / GRAVITY_M_S2)


def _touch_phase(run: RunTable) -> float:
    if run.touch_phase != "random":
        return run.touch_phase
    key = [run.seed, PHASE_STREAM]
    return float(np.random.Generator(np.random.Philox(key=key)).random())


def _name(material: MaterialKey) -> str:
    return material if isinstance(material, str) else material.name or ""


@lru_cache(maxsize=64)
def _plant_only(tables: PlantTables, run: RunTable, touch_phase: float) -> Setup:
    scene = Scene.model_construct(
        name="plain",
        shows="",
        materials=tables.materials,
        sphere=tables.sphere,
        plate=tables.plate,
        contact=tables.contact,
        sensors=_PLAIN_SENSORS,
        controller=_NO_CONTROL,
        actuator=tables.actuator,
        run=run.replaced(seed=0, touch_phase=touch_phase),
    )
    return resolve(scene)


@lru_cache(maxsize=64)
def _run_with(run: RunTable, key: str, value: str | float) -> RunTable:
    """One table for all cases that ask for the same: what is kept by tables is found faster."""
    return run.replaced(**{key: value})
