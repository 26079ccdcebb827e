"""The resolved scene: everything that a run is made of.

`resolve` computes the stages in one order: bodies -> line -> reach of the law -> plate model ->
plant -> sensor -> what the law may know. Every stage is a plain function of the tables and numbers
that it reads, in `stages`, and keeps its latest results by these. So a `Setup` that differs in one
key shares all stages that do not read this key.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.controller.controller import LineSpec
from hertzloop.controller.law import About, Reach
from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant.actuator import Actuator
from hertzloop.plant.contact.hertz import (
    Contact,
    Sphere,
)
from hertzloop.plant.estimates.model_order import UNDER_LAW
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.structures.structure import Structure
from hertzloop.scenes.controller_table import ControllerTable
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.loading import load as load_scene
from hertzloop.scenes.loading import parse as parse_scene
from hertzloop.scenes.plant_checks import not_in_three_dimensions
from hertzloop.scenes.scene import Scene
from hertzloop.scenes.tables import (
    ActuatorTable,
    ContactTable,
    HammerTable,
    MaterialKey,
    MaterialTable,
    PlateTable,
    RunTable,
    SensorsTable,
    SphereTable,
)
from hertzloop.scenes.varying import resolution_of
from hertzloop.scenes.varying import vary as vary_scene
from hertzloop.sensors.acquisition import SensorSpec
from hertzloop.setup import stages

PHASE_STREAM = 4  # random stream of the touch phase; sensor and controller have others
_KEPT_TABLES = 64
_PLAIN_SENSORS, _NO_CONTROL = SensorsTable(quantity="xi"), ControllerTable(law=NO_CONTROL)


class _Values:
    """What `resolve` computes."""

    # What the scene says in numbers.
    name: str
    step_ns: int
    step_s: float
    steps: int
    duration_s: float
    lead_in_s: float
    """flight before the first contact, s"""
    accuracy: float
    """relative error that the choice of the plate's model may cause"""
    seed: int
    """of noise, jitter, drop-outs and a random touch phase"""
    scheme: str
    """a key of SCHEMES"""
    quantity: str
    """sampled quantity, a key of SENSED"""
    every_steps: int
    """steps between two samples"""
    size_m: tuple[float, float] | None
    """length and width of the plate; None where modes stand for it"""
    law_reference: str
    """the law as the scene names it: a shipped name, a file, or a module"""
    has_law: bool
    """whether there is control at all"""
    law_is_shipped: bool
    """whether the law comes with hertzloop"""
    touch_phase: float
    """part of a step from the last sample above the plate to the first touch: the scene's, or drawn
    by its seed"""

    # The stages.
    bodies: stages.Bodies
    sphere: Sphere
    structure: Structure
    contact: Contact
    stiffness: float
    """contact stiffness that a law works with, N/m^1.5"""
    actuator: Actuator
    why_not_solid: str | None
    """why the plate cannot be in three dimensions; None if it can"""
    theory: str
    """theory of the plate: "kirchhoff" or "3d", as `plate.theory` comes to"""
    first_touch_s: float
    """when the sphere first touches the structure, from the start of the run, s"""
    line: LineSpec
    plate_material: str
    """name of the plate's material; "" for numbers without a name"""
    striker_material: str
    """that of the sphere or the hammer's tip"""
    latency_us: float
    """of the line beyond the one step that cannot be avoided, us; of a trace, the least"""
    reach: Reach
    """how far the law's force can go"""
    law_models_yield: bool
    """whether the law declares that it allows for a permanent dent; false if it is missing"""
    line_smoothness: stages.Smoothness
    with_edges: PlantSpec
    """the plant with modes, whether or not these are used"""
    plate_model: str
    """model of the plate, "modal" or "infinite", that `run.plate_model` comes to"""
    plant: PlantSpec
    sensor: SensorSpec
    converter_step: float
    """distance of two levels of the sensor's converter; zero of an ideal one"""
    about_bodies: About
    """what a law may know without a simulation and without the range of the converter"""


@dataclass(frozen=True)
class Setup(_Values):
    """A run in SI units, resolved from a scene by `resolve`. Reading a value computes nothing.

    Two setups are equal if their scenes are, and if they were announced the same stiffness.
    """

    scene: Scene
    announced_stiffness: float | None
    """contact stiffness that the plant of a run announced, N/m^1.5; a law then works with it. On
    another processor its last digit may differ from ours."""

    def __reduce__(self) -> tuple[Any, ...]:
        """The scene alone travels: stages may hold compiled code."""
        return resolve, (self.scene, self.announced_stiffness)

    # Other setups.

    def vary(self, values: Mapping[str, Any]) -> "Setup":
        """Return the setup with other values of some scene keys, "table.key": value.

        Only stages that read these keys are evaluated again. Raises SceneError.
        """
        return resolve(vary_scene(self.scene, values))

    def resolution_of(self, key: str) -> float:
        """Return how far apart the values of a scene key are; see `scenes.varying`."""
        return resolution_of(self.scene, key)

    def refusal(self, values: Mapping[str, Any]) -> str:
        """Return why the scene cannot have these values, in a sentence; "" if it can."""
        try:
            vary_scene(self.scene, values)
        except SceneError as error:
            return str(error)
        return ""

    def without_control(self) -> "Setup":
        """Return the same setup with the law switched off."""
        return resolve(self.scene.without_control())

    def uncontrolled(self) -> "Setup":
        """Return the setup without control on the same model of the plate; itself if it has no
        law."""
        if not self.has_law:
            return self
        return resolve(self._scene_with_run("plate_model", self.plate_model).without_control())

    def on_plate(self, plate_model: str) -> "Setup":
        """Return the setup with `run.plate_model` set."""
        scene = self._scene_with_run("plate_model", plate_model)
        alike = plate_model == self.plate_model and self.announced_stiffness is None
        if not alike or (plate_model == "infinite" != self.scene.run.plate_model):
            return resolve(scene)
        found = object.__new__(Setup)  # "auto" came to it: no stage differs
        found.__dict__.update(vars(self), scene=scene)
        return found

    def lasting(self, steps: int) -> "Setup":
        """Return the setup with a run of so many steps."""
        return resolve(self._scene_with_run("duration_s", steps * self.step_s))

    def _scene_with_run(self, key: str, value: str | float) -> Scene:
        return self.scene.replaced(run=_run_with(self.scene.run, key, value))

    def announced(self, stiffness: float) -> "Setup":
        """Return the setup with the stiffness, N/m^1.5, that the plant of a run announced."""
        return resolve(self.scene, stiffness)

    def renamed(self, name: str) -> "Setup":
        """Return the same setup under another name."""
        return resolve(self.scene.replaced(name=name))

    def plain(self) -> "Setup":
        """Return the setup without control, converters, seed and names: one for all setups whose
        plant alone behaves in the same way."""
        scene = self.scene
        return _plain(
            scene.sphere, scene.hammer, scene.plate, scene.contact, scene.actuator,
            scene.materials, scene.run, self.touch_phase, _felt(scene.sensors),
        )  # fmt: skip


Resolvable = Scene | Setup  # what a user may hand over


def resolve(scene: Resolvable, announced_stiffness: float | None = None) -> Setup:
    """Return the setup of a scene.

    Args:
        scene: a scene; a setup is returned as it is.
        announced_stiffness: contact stiffness that the plant of a run announced, N/m^1.5.

    Raises:
        SceneError: a stage refuses the scene.
    """
    if isinstance(scene, Setup):
        return scene
    run, control, sensors = scene.run, scene.controller, scene.sensors
    step_ns, touch_phase = run.step_ns, _touch_phase(run)
    step_s = step_ns * 1e-9
    striker = scene.sphere or scene.hammer
    assert striker is not None  # a scene has one
    materials = _name(scene.plate.material), _name(striker.material)
    sensed = sensors.point_m, sensors.mass_kg or 0.0
    bodies = stages.bodies_of(
        striker, scene.plate, scene.contact, scene.actuator, scene.materials, run.scheme,
        scene.plate.theory == "auto" and run.plate_model == "infinite", run.accuracy, sensed,
    )  # fmt: skip
    why_not_solid = bodies.why_not_solid
    if run.plate_model == "infinite":
        why_not_solid = not_in_three_dimensions(
            striker, scene.plate, scene.contact, scene.actuator, run.scheme, run.plate_model,
            False, sensors.mass_kg,
        )[0]  # fmt: skip
    first_touch_s = run.lead_in_s
    if gravity := bodies.sphere.gravity_m_s2:
        first_touch_s = min(first_touch_s, bodies.sphere.impact_speed_m_s / gravity)

    line = stages.line_of(control, scene.actuator, step_ns)
    latency_us = control.latency_us
    if control.latency_trace is not None:
        latency_us = line.latency_steps * step_ns / 1000
    smoothness = stages.smoothness_of(control, sensors, line, latency_us)
    reach, law_models_yield = stages.reach_of(control), stages.models_yield(control)

    controlled = bodies.structure.solid and control.law != NO_CONTROL
    with_edges = stages.described(
        bodies, scene.plate.tail, run.scheme, step_ns, run.lead_in_s,
        run.accuracy / (UNDER_LAW if controlled else 1.0),
    )  # fmt: skip
    plate_model = run.plate_model
    if plate_model == "auto":
        until_s = run.duration_s - first_touch_s
        error = stages.infinite_plate_error(bodies, run.scheme, reach, smoothness, step_s, until_s)
        plate_model = "infinite" if error <= run.accuracy else "modal"
    if plate_model == "infinite":
        plant = stages.without_edges(with_edges, step_ns)
    else:
        plant = stages.with_modes(with_edges, step_ns, run.scheme, run.accuracy)

    sensor = stages.sensor_of(sensors, bodies, step_s, latency_us)
    stiffness = announced_stiffness or bodies.contact.stiffness
    # The constructor of a frozen class takes 11 us to this one's 1 us, and a case of a sweep makes
    # several setups.
    found = object.__new__(Setup)
    found.__dict__.update(
        scene=scene,
        announced_stiffness=announced_stiffness,
        name=scene.name,
        step_ns=step_ns,
        step_s=step_s,
        steps=run.steps,
        duration_s=run.duration_s,
        lead_in_s=run.lead_in_s,
        accuracy=run.accuracy,
        seed=run.seed,
        scheme=run.scheme,
        quantity=sensors.quantity,
        every_steps=sensors.every_steps,
        size_m=scene.plate.size_m,
        law_reference=control.law,
        has_law=control.law != NO_CONTROL,
        law_is_shipped=control.law in shipped_laws(),
        touch_phase=touch_phase,
        bodies=bodies,
        sphere=bodies.sphere,
        structure=bodies.structure,
        contact=bodies.contact,
        stiffness=stiffness,
        actuator=bodies.actuator,
        why_not_solid=why_not_solid,
        theory=bodies.theory,
        plate_material=materials[0],
        striker_material=materials[1],
        first_touch_s=first_touch_s,
        line=line,
        latency_us=latency_us,
        reach=reach,
        law_models_yield=law_models_yield,
        line_smoothness=smoothness,
        with_edges=with_edges,
        plate_model=plate_model,
        plant=plant,
        sensor=sensor,
        converter_step=sensor.converter_step,
        about_bodies=stages.about_bodies(bodies, stiffness, line, step_ns, sensors.every_steps),
    )
    return found


def _touch_phase(run: RunTable) -> float:
    if run.touch_phase != "random":
        return run.touch_phase
    key = [run.seed, PHASE_STREAM]
    return float(np.random.Generator(np.random.Philox(key=key)).random())


def _name(material: MaterialKey) -> str:
    return material if isinstance(material, str) else material.name or ""


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Setup:
    """Read a scene by shipped name or from a file, and resolve it. See `scenes.loading.load`."""
    return resolve(load_scene(source, settings, seed))


def parse(text: str, settings: Iterable[str] = (), **more: Any) -> Setup:
    """Read a scene from TOML text, and resolve it. See `scenes.loading.parse`."""
    return resolve(parse_scene(text, settings, **more))


def _felt(sensors: SensorsTable) -> SensorsTable:
    """A sensor of which the plant feels as much as of another: its mass and where that is."""
    if sensors.mass_kg is None:
        return _PLAIN_SENSORS
    return _PLAIN_SENSORS.replaced(point_m=sensors.point_m, mass_kg=sensors.mass_kg)


@lru_cache(maxsize=_KEPT_TABLES)
def _plain(
    sphere: SphereTable | None,
    hammer: HammerTable | None,
    plate: PlateTable,
    contact: ContactTable,
    actuator: ActuatorTable,
    materials: tuple[MaterialTable, ...] | None,
    run: RunTable,
    touch_phase: float,
    sensors: SensorsTable,
) -> Setup:
    scene = Scene.model_construct(
        name="plain",
        shows="",
        materials=materials,
        sphere=sphere,
        hammer=hammer,
        plate=plate,
        contact=contact,
        sensors=sensors,
        controller=_NO_CONTROL,
        actuator=actuator,
        run=run.replaced(seed=0, touch_phase=touch_phase),
    )
    return resolve(scene)


@lru_cache(maxsize=_KEPT_TABLES)
def _run_with(run: RunTable, key: str, value: str | float) -> RunTable:
    """One table for all cases that ask for the same: what is kept by tables is found faster."""
    return run.replaced(**{key: value})
