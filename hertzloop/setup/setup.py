"""The resolved scene: everything that a run is made of.

The stages form a straight line: bodies -> contact -> reach of the law -> plate model -> plant ->
sensor -> what the law may know -> law. Every stage is a plain function of the tables and numbers
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
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant import time_series as ts
from hertzloop.plant.actuator import Actuator
from hertzloop.plant.contact.hertz import GRAVITY_M_S2, Contact, Sphere
from hertzloop.plant.estimates.model_order import expected_error, expected_solid_error, held_error
from hertzloop.plant.estimates.plate_theory import KirchhoffError
from hertzloop.plant.plant import Plant, PlantSpec
from hertzloop.plant.schemes.factory import plant_at_start
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.structure import Structure
from hertzloop.scenes.controller_table import ControllerTable
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.materials import MaterialTable
from hertzloop.scenes.problems import not_in_three_dimensions
from hertzloop.scenes.scene import Scene, grain_of, to_toml
from hertzloop.scenes.scene import load as load_scene
from hertzloop.scenes.scene import parse as parse_scene
from hertzloop.scenes.scene import vary as vary_scene
from hertzloop.scenes.tables import (
    ActuatorTable,
    ContactTable,
    PlateTable,
    RunTable,
    SensorsTable,
    SphereTable,
)
from hertzloop.sensors.acquisition import Sensor, SensorSpec
from hertzloop.setup import bodies as of_bodies
from hertzloop.setup import law as of_law
from hertzloop.setup import plate as of_plate
from hertzloop.setup.bodies import cached_property

PHASE_STREAM = 4  # random stream of the touch phase; sensor and controller have others
# Steps after the lead-in in which the first contact without control is looked for, four times as
# many at a time; the published scheme's work grows with their square.
_FIRST_STEPS = 1 << 10
_MOST_STEPS, _MOST_PUBLISHED = 1 << 20, 1 << 14
_KEPT_TABLES = 64
_PLAIN_SENSORS, _NO_CONTROL = SensorsTable(quantity="xi"), ControllerTable(law="off")


@dataclass(frozen=True)
class Setup:
    """A run in SI units, resolved from a scene.

    A stage is evaluated when it is first read, and raises SceneError then: some are costly, and a
    recording may outlive its law. `check` evaluates all that a run needs.

    `announced_stiffness`: contact stiffness that the plant of a run announced, N/m^1.5; a law then
    works with it. On another processor its last digit may differ from ours.
    """

    scene: Scene
    announced_stiffness: float | None = None

    def __getstate__(self) -> dict[str, Any]:
        """The scene alone: stages may hold compiled code."""
        return {"scene": self.scene, "announced_stiffness": self.announced_stiffness}

    # What the scene says in numbers.

    @property
    def name(self) -> str:
        """Name of the scene, and of its recording."""
        return self.scene.name

    @property
    def step_ns(self) -> int:
        """Length of a step, ns."""
        return self.scene.run.step_ns

    @cached_property
    def step_s(self) -> float:
        """Length of a step, s."""
        return self.scene.step_s

    @cached_property
    def steps(self) -> int:
        """Length of the run in steps."""
        return self.scene.steps

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
        """Name of the scheme, a key of SCHEMES."""
        return self.scene.run.scheme

    @property
    def quantity(self) -> str:
        """Name of the sampled quantity, a key of SENSED."""
        return self.scene.sensors.quantity

    @property
    def latency_us(self) -> float:
        """Latency of the line beyond the one step that cannot be avoided, us; of a trace, the
        least."""
        control = self.scene.controller
        if control.latency_trace is None:
            return control.latency_us
        return self.line.latency_steps * self.step_ns / 1000

    @cached_property
    def toml(self) -> str:
        """The scene as TOML, every key written out."""
        return to_toml(self.scene)

    @property
    def description(self) -> str:
        """What the scene shows, in a sentence."""
        return self.scene.shows

    @property
    def size_m(self) -> tuple[float, float] | None:
        """Length and width of the plate; None where modes stand for it."""
        return self.scene.plate.size_m

    @property
    def plate_model_asked(self) -> str:
        """`run.plate_model`: "auto" leaves the choice to the setup."""
        return self.scene.run.plate_model

    def grain_of(self, key: str) -> float:
        """Return how far apart the values of a scene key are. See `scenes.scene.grain_of`."""
        return grain_of(self.scene, key)

    def material_name(self, body: Literal["plate", "sphere"]) -> str:
        """Return the name of a body's material; "" for numbers without a name."""
        given = self.scene.plate.material if body == "plate" else self.scene.sphere.material
        return given if isinstance(given, str) else given.name or ""

    def toml_with_law(self, reference: str) -> str:
        """Return the scene as TOML with another reference to the same law."""
        control = self.scene.controller.replaced(law=reference)
        return to_toml(self.scene.replaced(controller=control))

    def in_steps(self, time_us: float) -> int:
        """Return a time in whole steps."""
        return self.scene.in_steps(time_us)

    # Stage 1: bodies and contact.

    @cached_property
    def bodies(self) -> of_bodies.Bodies:
        """Sphere, structure, contact and actuator."""
        scene, run = self.scene, self.scene.run
        return of_bodies.bodies_of(
            scene.sphere, scene.plate, scene.contact, scene.actuator, scene.materials,
            run.scheme, run.plate_model, run.accuracy,
        )  # fmt: skip

    @property
    def sphere(self) -> Sphere:
        """The sphere."""
        return self.bodies.sphere

    @property
    def structure(self) -> Structure:
        """The structure that the sphere hits."""
        return self.bodies.structure

    @property
    def contact(self) -> Contact:
        """The contact: stiffness, damping, and where it yields."""
        return self.bodies.contact

    @property
    def stiffness(self) -> float:
        """Contact stiffness that a law works with, N/m^1.5."""
        return self.announced_stiffness or self.contact.stiffness

    @property
    def actuator(self) -> Actuator:
        """The actuator between command and structure."""
        return self.bodies.actuator

    @property
    def theory(self) -> str:
        """Theory of the plate, "kirchhoff" or "3d"."""
        return self.bodies.theory

    @property
    def thin_plate_error(self) -> KirchhoffError:
        """What Kirchhoff's theory is expected to cost the first impact."""
        return of_bodies.thin_plate_error(self.bodies)

    @property
    def limiting_pressure(self) -> dict[str, Any] | None:
        """Pressure at which the contact yields, and where it comes from; None if it does not."""
        return of_bodies.limiting_pressure(self.bodies, self.scene.contact)

    @cached_property
    def first_touch_s(self) -> float:
        """When the sphere first touches the structure, from the start of the run, s."""
        return min(self.lead_in_s, self.sphere.impact_speed_m_s / GRAVITY_M_S2)

    @cached_property
    def touch_phase(self) -> float:
        """Part of a step from the last sample above the plate to the first touch: the scene's, or
        drawn by its seed."""
        phase = self.scene.run.touch_phase
        if phase == "random":
            key = [self.seed, PHASE_STREAM]
            return float(np.random.Generator(np.random.Philox(key=key)).random())
        return phase

    @property
    def why_not_solid(self) -> str | None:
        """Why the plate cannot be in three dimensions; None if it can."""
        scene = self.scene
        found = not_in_three_dimensions(
            scene.plate, scene.contact, scene.actuator, self.scheme, self.plate_model_asked
        )
        return found[0] if found else None

    # Stage 2: how far the modes are taken along, before it is known whether there are any.

    @cached_property
    def _described(self) -> PlantSpec:
        run = self.scene.run
        return of_plate.described(
            self.bodies, self.scene.plate.tail, run.scheme, run.step_ns, run.lead_in_s,
            run.accuracy,
        )  # fmt: skip

    @property
    def wavelengths_to_edge(self) -> float:
        """Distance of the contact point from the nearest edge, in bending waves at the limit."""
        return of_plate.wavelengths_to_edge(self.bodies, self.plant.frequency_limit_hz)

    # Stage 3: how far the law may go.

    @property
    def law(self) -> Law:
        """The law as it was found, without constants. Raises SceneError."""
        return of_law.law_of(self.scene.controller)

    @property
    def has_law(self) -> bool:
        """Whether there is control at all."""
        return self.scene.controller.law != "off"

    @property
    def law_reference(self) -> str:
        """The law as the scene names it: a shipped name, a file, or a module."""
        return self.scene.controller.law

    @property
    def law_is_shipped(self) -> bool:
        """Whether the law comes with hertzloop."""
        return self.law_reference in shipped_laws()

    @property
    def law_models_yield(self) -> bool:
        """Whether the law declares that it allows for a permanent dent; false if it is missing."""
        try:
            return bool(getattr(self.scene.controller.found, "models_yield", False))
        except LawError:
            return False

    @property
    def law_keys(self) -> Any:
        """The law's own keys, as attributes."""
        return self.scene.controller.keys

    @cached_property
    def reach(self) -> Reach:
        """How far the law's force can go."""
        return of_law.reach_of(self.scene.controller)

    # Stage 4: the model of the plate.

    @cached_property
    def _smoothness(self) -> of_plate.Smoothness:
        control, sensors = self.scene.controller, self.scene.sensors
        return of_plate.Smoothness(
            smooth=sensors.bits == control.bits == "ideal"
            and sensors.every_steps == 1
            and sensors.noise_rms == control.jitter_us == 0.0
            and sensors.fault is None
            and self.line.most_added_steps == self.line.dead_steps
            and self.line.stuck_step is None
            and control.drop_out_probability == 0.0
            and control.slew_n_s is None,
            latency_s=1e-6 * self.latency_us,
        )

    @cached_property
    def infinite_plate_error(self) -> float:
        """Error that an infinite plate is expected to have at the run's end, relative to the
        penetration or the plate energy; inf where it is not known."""
        return self.infinite_plate_error_at(self.duration_s)

    def infinite_plate_error_at(self, end_s: float) -> float:
        """Return `infinite_plate_error` of a run that ends at `end_s`, s."""
        until_s = end_s - self.first_touch_s
        return of_plate.infinite_plate_error(
            self.bodies, self.scheme, self.reach, self._smoothness, self.step_s, until_s
        )

    @cached_property
    def infinite_plate_lasts_s(self) -> float:
        """How long after the first touch an infinite plate meets the accuracy, s; zero where it
        does not do so for a whole contact."""
        return self.infinite_plate_lasts_up_to_s(math.inf)

    def infinite_plate_lasts_up_to_s(self, at_most_s: float) -> float:
        """Return `infinite_plate_lasts_s`, or `at_most_s` if it lasts longer."""
        return of_plate.infinite_plate_lasts_s(
            self.bodies, self.scheme, self.reach, self._smoothness, self.step_s, self.accuracy,
            at_most_s,
        )  # fmt: skip

    @cached_property
    def plate_model(self) -> str:
        """Model of the plate, "modal" or "infinite", that `run.plate_model` comes to.

        "auto" is "infinite" where the run ends after the first contact, but before the
        reflections matter at the accuracy asked for; a run without contact keeps the modes.
        """
        chosen = self.scene.run.plate_model
        if chosen != "auto":
            return chosen
        return "infinite" if self.infinite_plate_error <= self.accuracy else "modal"

    # Stage 5: the plant.

    @cached_property
    def plant(self) -> PlantSpec:
        """Description of the plant. Raises SceneError if the scene asks for too many modes."""
        spec = self._described
        if self.plate_model == "infinite":
            return of_plate.without_edges(spec, self.step_ns)
        return of_plate.with_modes(spec, self.step_ns, self.scheme, self.accuracy)

    @cached_property
    def expected_error(self) -> float:
        """Relative error of penetration or plate energy that leaving out modes, or the reflections,
        is expected to cost; under a law at least what the steps of its force do."""
        spec = self.plant
        if spec.infinite_plate:
            return self.infinite_plate_error
        if spec.plate.solid:
            return expected_solid_error(
                spec.sphere, spec.plate, spec.contact, spec.frequency_limit_hz
            )
        found = expected_error(
            spec.sphere, spec.plate, spec.contact, spec.frequency_limit_hz,
            spring=spec.residual_flexibility, damped=spec.damped_tail,
        )  # fmt: skip
        return max(found, self._held_error(spec)) if spec.residual_flexibility else found

    def _held_error(self, spec: PlantSpec) -> float:
        """What a law's force, held from sample to sample, costs; a bandwidth rounds its steps."""
        if self.reach.force_n < math.inf:
            return 0.0
        hold_s = self.step_s * self.scene.sensors.every_steps
        rounded = min(1.0, ((spec.actuator.bandwidth_hz or math.inf) * hold_s) ** 2)
        share = min(self.reach.share, 1.0) * rounded
        return held_error(spec.sphere, spec.contact, share, hold_s, damped=spec.damped_tail)

    # Stage 6: sensor and line.

    @cached_property
    def sensor(self) -> SensorSpec:
        """The data-acquisition channel."""
        return of_law.sensor_of(self.scene.sensors, self.bodies, self.step_s, self.latency_us)

    @property
    def every_steps(self) -> int:
        """Steps between two samples."""
        return self.scene.sensors.every_steps

    @cached_property
    def converter_step(self) -> float:
        """Distance of two levels of the sensor's converter; zero of an ideal one."""
        spec = self.sensor
        if spec.bits is None or spec.full_scale is None:
            return 0.0
        return (spec.full_scale[1] - spec.full_scale[0]) / (2**spec.bits - 1)

    @cached_property
    def line(self) -> LineSpec:
        """The line from the law to the actuator."""
        return of_law.line_of(self.scene.controller, self.scene.actuator, self.step_ns)

    # Stage 7: the law.

    @cached_property
    def about_bodies(self) -> About:
        """What a law may know without a simulation and without the range of the converter."""
        limit_n = self.line.full_scale_n
        return replace(
            of_law.about_impact(self.bodies, self.stiffness),
            step_ns=self.step_ns,
            every_steps=self.every_steps,
            # The force of a sample acts one step after it at the earliest.
            horizon_steps=1 + self.line.latency_steps,
            limit_n=math.inf if limit_n is None else limit_n,
        )

    @cached_property
    def about(self) -> About:
        """What a law may know of the run.

        Here a stage needs a later one: a law that is computed beforehand asks for the contact force
        without control, which is a simulation of the plant alone.
        """
        return replace(
            self.about_bodies,
            converter_step=self.converter_step,
            uncontrolled_force_n=lambda: self.uncontrolled_force_n,
        )

    @cached_property
    def uncontrolled_force_n(self) -> np.ndarray:
        """Contact force of the first impact without control, from the sample at its start, N; in
        the published scheme its elastic part; shape (samples in contact,).

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

    def bound_law(self, ahead: bool = True) -> BoundLaw:
        """The law with its constants; without `ahead` its commands alone. Raises SceneError."""
        return self._bound_law if ahead else self._bind_law(ahead)

    @cached_property
    def _bound_law(self) -> BoundLaw:
        return self._bind_law(ahead=True)

    def _bind_law(self, ahead: bool) -> BoundLaw:
        # All that the contact force without control follows from, which `about` does not show.
        free = (
            self._described, self.touch_phase, self.scheme, self.plate_model_asked, self.accuracy,
        )  # fmt: skip
        return of_law.bound_law(self.scene.controller, self.about, self.bodies, free, ahead)

    @cached_property
    def law_flight_m(self) -> float:
        """How far above the plate the law has to see the sphere, m: what it flies in the latency
        and the law's window; zero of a law that waits for the contact, or is not shipped. Raises
        SceneError."""
        if not self.law_is_shipped:  # a recording must not have others called
            return 0.0
        level = self.bound_law().waits_above
        if not 0.0 < level < math.inf:
            return 0.0
        known = self.about_bodies
        window = getattr(self.law_keys, "window_samples", 1) * known.sample_s
        return min(level, known.impact_speed_m_s * (known.horizon_s + window))

    # The parts at the start of a run.

    def start_plant(self, spec: PlantSpec | None = None, steps: int | None = None) -> Plant:
        """The plant at the start of the run, or that of another description `spec` by the same
        scheme, for as many `steps` as are to be run, by default all. Raises SceneError for what the
        scheme does not know."""
        steps = steps or self.steps
        try:
            return plant_at_start(spec or self.plant, self.scheme, steps, self.touch_phase)
        except ValueError as error:
            raise SceneError(str(error)) from error

    def free_series(self) -> Iterator[tuple[int, np.ndarray]]:
        """Simulate the plant alone, without any force of the actuator; its time series in blocks:
        first step, and an array of shape (10, steps of the block)."""
        return ts.free_series(self.start_plant(), self.steps)

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
        return Setup(vary_scene(self.scene, values))

    def without_control(self) -> "Setup":
        """Return the same setup with the law switched off."""
        return Setup(self.scene.without_control())

    def uncontrolled(self) -> "Setup":
        """Return the setup without control on the same model of the plate; itself if it has no
        law."""
        return self.without_control().on_plate(self.plate_model) if self.has_law else self

    def on_plate(self, plate_model: str) -> "Setup":
        """Return the setup with `run.plate_model` set."""
        return self._with_run("plate_model", plate_model)

    def lasting(self, steps: int) -> "Setup":
        """Return the setup with a run of so many steps."""
        return self._with_run("duration_s", steps * self.step_s)

    def _with_run(self, key: str, value: str | float) -> "Setup":
        run = _run_with(self.scene.run, key, value)
        return Setup(self.scene.replaced(run=run))

    def renamed(self, name: str) -> "Setup":
        """Return the same setup under another name."""
        return Setup(self.scene.replaced(name=name))

    def plain(self) -> "Setup":
        """Return the setup without control, converters, seed and names: one for all setups whose
        plant alone behaves in the same way."""
        scene = self.scene
        return _plain(
            scene.sphere, scene.plate, scene.contact, scene.actuator, scene.materials, scene.run,
            self.touch_phase,
        )  # fmt: skip


Resolvable = Scene | Setup  # what a user may hand over


def resolve(scene: Resolvable) -> Setup:
    """Return the setup of a scene; its stages are evaluated as they are read."""
    return scene if isinstance(scene, Setup) else Setup(scene)


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Setup:
    """Read a scene by shipped name or from a file, and resolve it. See `scenes.scene.load`."""
    return Setup(load_scene(source, settings, seed))


def parse(text: str, settings: Iterable[str] = (), **more: Any) -> Setup:
    """Read a scene from TOML text, and resolve it. See `scenes.scene.parse`."""
    return Setup(parse_scene(text, settings, **more))


@lru_cache(maxsize=_KEPT_TABLES)
def _plain(
    sphere: SphereTable,
    plate: PlateTable,
    contact: ContactTable,
    actuator: ActuatorTable,
    materials: tuple[MaterialTable, ...] | None,
    run: RunTable,
    touch_phase: float,
) -> Setup:
    scene = Scene.model_construct(
        name="plain",
        shows="",
        materials=materials,
        sphere=sphere,
        plate=plate,
        contact=contact,
        sensors=_PLAIN_SENSORS,
        controller=_NO_CONTROL,
        actuator=actuator,
        run=run.replaced(seed=0, touch_phase=touch_phase),
    )
    return Setup(scene)


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
        short = free._with_run("duration_s", lead_s + steps * free.step_s)
        truth = ts.series_under(short.start_plant(), np.zeros(short.steps))
        found = of_law.first_contact_force_n(truth, free.contact.stiffness, published)
        if found is not None:
            return found, steps * free.step_s
        steps *= 4
    return None, steps / 4 * free.step_s
