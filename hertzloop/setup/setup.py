"""The resolved scene: everything that a run is made of.

`resolve` computes the stages in one order: bodies -> line -> reach of the law -> plate model ->
plant -> sensor -> what the law may know. Every stage is a plain function of the tables and numbers
that it reads, in `bodies`, `plate` or `law` of this package, and keeps its latest results by these.
So a `Setup` that differs in one key shares all stages that do not read this key.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from hertzloop.controller.controller import Controller, LineSpec
from hertzloop.controller.law import About, Reach
from hertzloop.controller.loading.bound import BoundLaw
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.registry import NO_CONTROL, controls
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant import time_series as ts
from hertzloop.plant.actuator import Actuator, rest_force_n
from hertzloop.plant.contact.hertz import Contact, Sphere
from hertzloop.plant.estimates.model_order import expected_error, expected_solid_error, law_error
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.factory import plant_at_start
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.structure import Structure
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.materials import MaterialTable
from hertzloop.scenes.scene import (
    ControllerTable,
    Scene,
    grain_of,
    not_in_three_dimensions,
    to_toml,
)
from hertzloop.scenes.scene import load as load_scene
from hertzloop.scenes.scene import parse as parse_scene
from hertzloop.scenes.scene import vary as vary_scene
from hertzloop.scenes.tables import (
    ActuatorTable,
    ContactTable,
    HammerTable,
    PlateTable,
    RunTable,
    SensorsTable,
    SphereTable,
)
from hertzloop.sensors.acquisition import Sensor, SensorSpec
from hertzloop.setup import bodies as of_bodies
from hertzloop.setup import law as of_law
from hertzloop.setup import plate as of_plate

PHASE_STREAM = 4  # random stream of the touch phase; sensor and controller have others
# Steps after the lead-in in which the first contact without control is looked for, four times as
# many at a time; the published scheme's work grows with their square.
_FIRST_STEPS = 1 << 10
_MOST_STEPS, _MOST_PUBLISHED = 1 << 20, 1 << 14
_KEPT_TABLES = 64
_PLAIN_SENSORS, _NO_CONTROL = SensorsTable(quantity="xi"), ControllerTable(law=NO_CONTROL)


@dataclass(frozen=True, eq=False, init=False)
class Setup:
    """A run in SI units, resolved from a scene by `resolve`. Reading a value computes nothing.

    Two setups are equal if their scenes are, and if they were announced the same stiffness.
    """

    scene: Scene
    announced_stiffness: float | None
    """contact stiffness that the plant of a run announced, N/m^1.5; a law then works with it. On
    another processor its last digit may differ from ours."""

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
    bodies: of_bodies.Bodies
    sphere: Sphere
    structure: Structure
    contact: Contact
    stiffness: float
    """contact stiffness that a law works with, N/m^1.5"""
    actuator: Actuator
    theory: str
    """theory of the plate: "kirchhoff" or "3d", as `plate.theory` comes to"""
    first_touch_s: float
    """when the sphere first touches the structure, from the start of the run, s"""
    line: LineSpec
    latency_us: float
    """of the line beyond the one step that cannot be avoided, us; of a trace, the least"""
    reach: Reach
    """how far the law's force can go"""
    law_models_yield: bool
    """whether the law declares that it allows for a permanent dent; false if it is missing"""
    line_smoothness: of_plate.Smoothness
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

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Setup):
            return NotImplemented
        return (self.scene, self.announced_stiffness) == (other.scene, other.announced_stiffness)

    def __hash__(self) -> int:
        return hash((self.scene, self.announced_stiffness))

    def __reduce__(self) -> tuple[Any, ...]:
        """The scene alone travels: stages may hold compiled code."""
        return resolve, (self.scene, self.announced_stiffness)

    # What the scene says in words.

    @property
    def description(self) -> str:
        """What the scene shows, in a sentence."""
        return self.scene.shows

    @property
    def plate_model_asked(self) -> str:
        """`run.plate_model`: "auto" leaves the choice to the setup."""
        return self.scene.run.plate_model

    @property
    def law(self) -> Law:
        """The law as it was found, without constants. Raises SceneError where a recording has
        outlived its law."""
        return of_law.law_of(self.scene.controller)

    @property
    def law_keys(self) -> Any:
        """The law's own keys, as attributes."""
        return self.scene.controller.keys

    def as_toml(self, law: str | None = None) -> str:
        """Return the scene as TOML, every key written out; `law`: another reference to the same
        law."""
        if law is None:
            return to_toml(self.scene)
        return to_toml(self.scene.replaced(controller=self.scene.controller.replaced(law=law)))

    def grain_of(self, key: str) -> float:
        """Return how far apart the values of a scene key are. See `scenes.scene.grain_of`."""
        return grain_of(self.scene, key)

    def material_name(self, body: Literal["plate", "sphere"]) -> str:
        """Return the name of a body's material; "" for numbers without a name."""
        given = self.scene.plate.material if body == "plate" else self.scene.striker.material
        return given if isinstance(given, str) else given.name or ""

    # Stages that only some commands need.

    def why_not_solid(self) -> str | None:
        """Return why the plate cannot be in three dimensions; None if it can."""
        scene = self.scene
        found = not_in_three_dimensions(
            scene.striker, scene.plate, scene.contact, scene.actuator, self.scheme,
            self.plate_model_asked, scene.material("plate").orthotropic, scene.sensors.mass_kg,
        )  # fmt: skip
        return found[0] if found else None

    def infinite_plate_error_at(self, end_s: float) -> float:
        """Return the error that an infinite plate is expected to have in a run that ends at
        `end_s`, s, relative to the penetration or the plate energy; inf where it is not known."""
        return of_plate.infinite_plate_error(
            self.bodies, self.scheme, self.reach, self.line_smoothness, self.step_s,
            end_s - self.first_touch_s,
        )  # fmt: skip

    def infinite_plate_lasts_s(self, at_most_s: float = math.inf) -> float:
        """Return how long after the first touch an infinite plate meets the accuracy, s, or
        `at_most_s` if that is longer; zero where it does not do so for a whole contact."""
        return of_plate.infinite_plate_lasts_s(
            self.bodies, self.scheme, self.reach, self.line_smoothness, self.step_s, self.accuracy,
            at_most_s,
        )  # fmt: skip

    def expected_error(self, until_hz: float = math.inf) -> float:
        """Return the relative error of penetration or plate energy that leaving out modes, or the
        reflections, is expected to cost; under a law at least what the steps of its force do.
        `until_hz`: of these steps count in a solid only what they do below this frequency."""
        spec = self.plant
        if spec.infinite_plate:
            return self.infinite_plate_error_at(self.duration_s)
        parts = (spec.sphere, spec.plate, spec.contact)
        if spec.plate.solid:
            found = expected_solid_error(*parts, spec.frequency_limit_hz)
            until_hz = min(
                until_hz, of_plate.widest_limit_hz(spec.plate, spec.sphere, spec.contact)
            )
        else:
            found = expected_error(
                *parts, spec.frequency_limit_hz,
                spring=spec.residual_flexibility, damped=spec.damped_tail,
            )  # fmt: skip
        if not spec.residual_flexibility:
            return found
        hold_s = self.step_s * self.every_steps
        return max(found, law_error(spec, self.reach.force_n, self.reach.share, hold_s, until_hz))

    # The law with its constants.

    def about(self) -> About:
        """Return what a law may know of the run.

        A law that is computed beforehand asks for the contact force without control, which is a
        simulation of the plant alone.
        """
        return replace(
            self.about_bodies,
            converter_step=self.converter_step,
            uncontrolled_force_n=self.uncontrolled_force_n,
        )

    def uncontrolled_force_n(self) -> np.ndarray:
        """Return the contact force of the first impact without control, from the sample at its
        start, N; in the published scheme its elastic part; shape (samples in contact,).

        Raises:
            LawError: the contact lasts longer than is worth following.
        """
        found, followed_s = _uncontrolled_force_n(self.without_control().plain())
        if found is None:
            raise LawError(
                f"controller.law = '{self.law_reference}' needs the contact force without control, "
                f"but the first contact does not end within {followed_s:g} s. Use a harder plate, "
                "less contact.viscous_n_s_m, or another law."
            )
        return found

    def law_constants(self) -> Any:
        """Return what the functions of the law know. Raises SceneError."""
        return of_law.constants_of(self.scene.controller, self.about(), self.bodies)

    def bound_law(self, ahead: bool = True) -> BoundLaw:
        """Return the law with its constants; without `ahead` its commands alone. Raises
        SceneError."""
        # All that the contact force without control follows from, which `about` does not show.
        free = (
            self.with_edges, self.touch_phase, self.scheme, self.plate_model_asked, self.accuracy,
        )  # fmt: skip
        return of_law.bound_law(self.scene.controller, self.about(), self.bodies, free, ahead)

    def law_flight_m(self) -> float:
        """Return how far above the plate the law has to see the sphere, m: what it flies in the
        latency and the law's window; zero of a law that waits for the contact, or is not shipped.
        Raises SceneError."""
        if not self.law_is_shipped:  # a recording must not have others called
            return 0.0
        level = self.bound_law().waits_above
        if not 0.0 < level < math.inf:
            return 0.0
        known = self.about_bodies
        window = getattr(self.law_keys, "window_samples", 1) * known.sample_s
        return min(level, known.impact_speed_m_s * (known.horizon_s + window))

    # The parts at the start of a run.

    def start_plant(
        self, spec: PlantSpec | None = None, steps: int | None = None, *, flight: bool = False
    ) -> Plant:
        """The plant at the start of the run, or that of another description `spec` by the same
        scheme, for as many `steps` as are to be run, by default all; `flight`: no impact is asked
        of it. Raises SceneError for what the scheme does not know, and modes too low for impacts.
        """
        steps = steps or self.steps
        if not flight:
            of_plate.check_reach(spec or self.plant)
        try:
            return plant_at_start(spec or self.plant, self.scheme, steps, self.touch_phase)
        except ValueError as error:
            raise SceneError(str(error)) from error

    def free_series(self) -> Iterator[tuple[int, np.ndarray]]:
        """Simulate the plant alone, without any force of the actuator; its time series in blocks:
        first step, and an array of shape (10, steps of the block)."""
        return ts.free_series(self.start_plant(), self.steps)

    def control_force_n(self, rows: np.ndarray) -> np.ndarray:
        """Return the actuator's force beyond that without a command, N, of rows of a time series,
        shape (10, steps)."""
        rest_n = rest_force_n(self.actuator, self.step_s)
        return rows[ts.F_A] - rest_n if rest_n else rows[ts.F_A]

    def start_sensor(self, steps: int | None = None) -> Sensor:
        """The data-acquisition channel at the start of the run, for as many `steps` as are to be
        run, by default all."""
        return Sensor(self.sensor, self.step_s, steps or self.steps, self.seed)

    def start_controller(self, ahead: bool = True, steps: int | None = None) -> Controller:
        """Law and line at the start of the run; `ahead` as of `bound_law`, `steps` as of
        `start_sensor`. Raises SceneError."""
        bound, steps = self.bound_law(ahead), steps or self.steps
        return Controller(bound, self.line, self.step_s, steps, self.every_steps, self.seed)

    def check(self) -> None:
        """Build all parts of the run once. Raises SceneError."""
        self.start_sensor()
        self.start_plant()
        self.start_controller()

    # Other setups.

    def vary(self, values: Mapping[str, Any]) -> "Setup":
        """Return the setup with other values of some scene keys, "table.key": value.

        Only stages that read these keys are evaluated again. Raises SceneError.
        """
        return resolve(vary_scene(self.scene, values))

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
        return self.without_control().on_plate(self.plate_model) if self.has_law else self

    def on_plate(self, plate_model: str) -> "Setup":
        """Return the setup with `run.plate_model` set."""
        scene = self._scene_with_run("plate_model", plate_model)
        if plate_model != self.plate_model or self.announced_stiffness is not None:
            return resolve(scene)
        return _made(**{**vars(self), "scene": scene})  # "auto" came to it: no stage differs

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
    step_ns, step_s, touch_phase = run.step_ns, run.step_s, _touch_phase(run)
    bodies = of_bodies.bodies_of(
        scene.striker, scene.plate, scene.contact, scene.actuator, scene.materials,
        run.scheme, run.plate_model, run.accuracy, (sensors.point_m, sensors.mass_kg or 0.0),
    )  # fmt: skip
    first_touch_s = run.lead_in_s
    if gravity := bodies.sphere.gravity_m_s2:
        first_touch_s = min(first_touch_s, bodies.sphere.impact_speed_m_s / gravity)

    line = of_law.line_of(control, scene.actuator, step_ns)
    latency_us = control.latency_us
    if control.latency_trace is not None:
        latency_us = line.latency_steps * step_ns / 1000
    smoothness = of_law.smoothness_of(control, sensors, line, latency_us)
    reach, law_models_yield = of_law.reach_of(control), of_law.models_yield(control)

    with_edges = of_plate.described(
        bodies, scene.plate.tail, run.scheme, step_ns, run.lead_in_s, run.accuracy
    )
    plate_model = run.plate_model
    if plate_model == "auto":
        until_s = run.duration_s - first_touch_s
        error = of_plate.infinite_plate_error(
            bodies, run.scheme, reach, smoothness, step_s, until_s
        )
        plate_model = "infinite" if error <= run.accuracy else "modal"
    if plate_model == "infinite":
        plant = of_plate.without_edges(with_edges, step_ns)
    else:
        plant = of_plate.with_modes(with_edges, step_ns, run.scheme, run.accuracy)

    sensor = of_law.sensor_of(sensors, bodies, step_s, latency_us)
    stiffness = announced_stiffness or bodies.contact.stiffness
    return _made(
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
        has_law=controls(control.law),
        law_is_shipped=control.law in shipped_laws(),
        touch_phase=touch_phase,
        bodies=bodies,
        sphere=bodies.sphere,
        structure=bodies.structure,
        contact=bodies.contact,
        stiffness=stiffness,
        actuator=bodies.actuator,
        theory=bodies.theory,
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
        about_bodies=of_law.about_bodies(bodies, stiffness, line, step_ns, sensors.every_steps),
    )


def _made(**values: Any) -> Setup:
    """Return a setup of these values. The constructor of a frozen class takes 11 us to their 1 us,
    and a case of a sweep makes several setups."""
    found = object.__new__(Setup)
    found.__dict__.update(values)
    return found


def _touch_phase(run: RunTable) -> float:
    if run.touch_phase != "random":
        return run.touch_phase
    key = [run.seed, PHASE_STREAM]
    return float(np.random.Generator(np.random.Philox(key=key)).random())


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Setup:
    """Read a scene by shipped name or from a file, and resolve it. See `scenes.scene.load`."""
    return resolve(load_scene(source, settings, seed))


def parse(text: str, settings: Iterable[str] = (), **more: Any) -> Setup:
    """Read a scene from TOML text, and resolve it. See `scenes.scene.parse`."""
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


@lru_cache(maxsize=16)
def _uncontrolled_force_n(free: Setup) -> tuple[np.ndarray | None, float]:
    """The force, None of a contact that lasts too long; how long it was followed, s."""
    published = not SCHEMES[free.scheme].conserves
    steps, lead_s = _FIRST_STEPS, free.lead_in_s
    while steps <= (_MOST_PUBLISHED if published else _MOST_STEPS):
        short = resolve(free._scene_with_run("duration_s", lead_s + steps * free.step_s))
        truth = ts.series_under(short.start_plant(), np.zeros(short.steps))
        found = of_law.first_contact_force_n(truth, free.contact.stiffness, published)
        if found is not None:
            return found, steps * free.step_s
        steps *= 4
    return None, steps / 4 * free.step_s
