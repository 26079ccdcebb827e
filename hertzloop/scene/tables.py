"""The tables of a scene: keys, bounds and defaults."""

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    WrapValidator,
    field_validator,
)

from hertzloop.common.number_fields import refuse_no_numbers
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.registry import STRUCTURES, THEORIES
from hertzloop.scene.errors import shown
from hertzloop.scene.quantities import SENSED
from hertzloop.sensors.acquisition import HIGHEST_ORDER


class SceneTable(BaseModel):
    """A table of a scene: no other keys, no change, finite numbers; a docstring for each key,
    which `hertzloop scene keys` prints."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=False,
        allow_inf_nan=False,
    )
    __slots__ = ("_hash",)  # a copy has none yet
    _numbers = field_validator("*", mode="wrap")(refuse_no_numbers)

    def replaced(self, **values: Any) -> Self:
        """Return a copy with other values, which are not checked."""
        return self.model_copy(update=values)

    def __hash__(self) -> int:
        """Kept: what many scenes share is looked up by its tables again and again. Numbers among
        the keys of a law count, else all values of a sweep would be one for a lookup."""
        found: int | None = getattr(self, "_hash", None)
        if found is None:
            of_law = (self.__pydantic_extra__ or {}).values()
            numbers = (value for value in of_law if isinstance(value, int | float))
            found = hash((type(self), *vars(self).values(), *numbers))
            object.__setattr__(self, "_hash", found)
        return found


class MaterialTable(SceneTable):
    """A material by its numbers; `plant.structures.materials` says which can be. `name`, in a
    list of materials, is what plate.material and sphere.material may say."""

    name: str | None = None
    young_pa: float | None = None
    density_kg_m3: float
    poisson: float | None = None
    loss_factor: float | None = None
    restitution: float | None = None
    yield_pa: float | None = None
    hardness_pa: float | None = None
    strength_spread: float | None = None


class ModesTable(SceneTable):
    """A file of modes, taken into the scene: its name, the digest of its bytes, and these, packed
    by zlib, in base64."""

    file: str
    sha256: str
    content: Annotated[str, Field(repr=False)]


MaterialKey = str | MaterialTable


def _none_of_zero(value: object) -> object:
    """No mass is none: a sweep over it may begin there."""
    return None if value == 0 and not isinstance(value, bool) else value


# The tables and their keys: kinds, bounds and defaults.

Point = tuple[float, float]
# Bounds are far beyond what a laboratory has, and within what the numerics can carry.
Level = Annotated[float, Field(ge=-1e9, le=1e9)]


def _scheme(name: object, check: Callable[[object], str]) -> str:
    """A name in `SCHEMES`, which a program may have added to since this module was loaded."""
    return name if isinstance(name, str) and name in SCHEMES else check(name)


def _theory(name: object, check: Callable[[object], str]) -> str:
    """A theory in `STRUCTURES`, which a program may have added as well."""
    kind = STRUCTURES.get(name) if isinstance(name, str) else None
    return str(name) if kind is not None and kind.theory else check(name)


if TYPE_CHECKING:
    SchemeName = str
    TheoryName = str
else:
    SchemeName = Annotated[Literal[*SCHEMES], WrapValidator(_scheme)]
    TheoryName = Annotated[Literal[*THEORIES], WrapValidator(_theory)]


Mass = Annotated[float, Field(ge=1e-9, le=1e4)]
Speed = Annotated[float, Field(ge=1e-3, le=45.0)]
Side = Annotated[float, Field(ge=0.01, le=20.0)]
Thickness = Annotated[float, Field(ge=1e-5, le=1.0)]
Radius = Annotated[float, Field(ge=1e-5, le=1.0)]


class SphereTable(SceneTable):
    """The falling sphere, by its impact speed or the height of its fall. `mass_kg` stands in for
    the density of its material."""

    material: MaterialKey = "steel"
    """name, or numbers"""
    radius_m: Radius
    """sphere radius"""
    mass_kg: Mass | None = None
    """sphere mass; default: by the density of its material"""
    speed_m_s: Speed | None = None
    """impact speed, in place of the drop height"""
    drop_height_m: Annotated[float, Field(ge=1e-7, le=100.0)] | None = None
    """drop height of the lowest point of the sphere above the plate"""

    @property
    def fall_m(self) -> float:
        """Height of the fall, or of one to the impact speed, m."""
        if self.drop_height_m is not None:
            return self.drop_height_m
        speed_m_s = self.speed_m_s or 0.0
        return speed_m_s * speed_m_s / (2.0 * GRAVITY_M_S2)


class PlateTable(SceneTable):
    """The plate by its sizes, or a file of modes in its place. `actuator_point_m` is by default the
    contact point. `theory`: Kirchhoff's thin plate, or a structure of one's own. `tail` stands for
    the truncated modes: a massless spring or one damped mode; "auto" is "damped" where that is
    known.

    A file of modes defines the structure: `size_m` and `contact_point_m` then serve the picture
    only, and `thickness_m` is that of the plate at the contact point, if it is one."""

    material: MaterialKey
    """name, or numbers"""
    size_m: tuple[Side, Side] | None = None
    """plate length and width"""
    thickness_m: Thickness | None = None
    """plate thickness"""
    contact_point_m: Point | None = None
    """contact point, measured from a corner"""
    actuator_point_m: Point | None = None
    """actuator point; default: the contact point"""
    tail: Literal["spring", "damped", "auto"] = "auto"
    """model of the truncated modes: massless spring or one damped mode; "auto": damped where
    that is known"""
    modes: ModesTable | None = None
    """file of modes that replaces the plate (CSV, NPZ)"""
    residual_flexibility_m_n: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """static flexibility of the modes that are not in the file of plate.modes"""
    loss_factor: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """loss factor of every mode; default: that of the material"""
    edges: str | None = None
    """edge conditions at x = 0, x = l_x, y = 0, y = l_y: c clamped, s simply supported, f free;
    default: ssss"""
    theory: TheoryName = "kirchhoff"
    """Kirchhoff's thin plate, or the name of your own structure"""

    @property
    def points_m(self) -> tuple[Point, Point]:
        """Contact point and actuator point; the corner if a file of modes defines the structure."""
        contact = self.contact_point_m or (0.0, 0.0)
        return contact, self.actuator_point_m or contact

    @field_validator("edges")
    @classmethod
    def _four_edges(cls, value: str | None) -> str | None:
        if value is not None and not re.fullmatch("[cfs]{4}", value):
            raise ValueError(
                f"plate.edges = {shown(value)}: must be four letters, for the edges at x = 0, x = "
                "l_x, y = 0 and y = l_y. Give c (clamped), s (simply supported) or f (free) for "
                "each, as in 'cccc'"
            )
        return value


class ContactTable(SceneTable):
    """The contact.

    `plasticity` "thornton": the contact yields where the pressure reaches the limiting one, between
    1.6 times the softer body's yield strength and its hardness; left out, it is that hardness, or
    2.8 times the yield strength of a material that has no hardness. "auto": "thornton" where the
    first impact on a rigid plate would pass first yield, or a limiting pressure is given; "none"
    where it would not, where the plate's strength is not known, beside contact damping, and where
    the scheme knows no yield.

    `damping` "viscous": a dashpot beside the contact; "hunt_crossley": in proportion to the elastic
    force; "relaxation": a second contact stiffness that relaxes, with s_tau, tau and the solve."""

    damping: Literal["none", "viscous", "hunt_crossley", "relaxation"] = "none"
    """damping model of the contact"""
    plasticity: Literal["none", "thornton", "auto"] = "auto"
    """yield of the contact by Thornton's model; "auto": where the first impact would pass first
    yield"""
    limiting_pressure_pa: Annotated[float, Field(ge=1e3, le=1e13)] | None = None
    """limiting contact pressure at yield"""
    stiffness_factor: Annotated[float, Field(ge=1e-2, le=1e2)] | None = None
    """factor on the stiffness of Hertz's contact, as of a fit; default: 1"""
    viscous_n_s_m: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    """damping constant of "viscous"; the damper also pulls while the bodies separate"""
    restitution: Annotated[float, Field(ge=1e-3, le=1.0)] = 1.0
    """coefficient of restitution of "hunt_crossley" on a massive body, at the speed of the first
    impact; later, slower impacts are damped less"""
    relaxation_stiffness: Annotated[float, Field(ge=0.0, le=1e15)] = 0.0
    """stiffness s_tau of "relaxation", N/m^1.5"""
    relaxation_s: Annotated[float, Field(ge=1e-9, le=1e3)] = 1e-3
    """time constant of the relaxation"""
    relaxation_solve: Literal["published", "bracketed"] = "bracketed"
    """solver of "relaxation": the published iteration or a bracketed one"""


class SensorsTable(SceneTable):
    """Data acquisition. `quantity` "auto", the default, is the quantity that the law needs;
    `full_scale` is lowest and highest value, "auto", which for the gap holds the flight that a law
    has to see, "contact", which does not, or "none"."""

    quantity: Literal[(*SENSED, "auto")] = "auto"  # type: ignore[valid-type]
    """sampled quantity; "auto": the one that the law needs"""
    every_steps: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    """sampling period, steps"""
    bits: Annotated[int, Field(ge=1, le=24)] | Literal["ideal"] = "ideal"
    """ADC resolution, bits"""
    full_scale: tuple[Level, Level] | Literal["auto", "contact", "none"] = "auto"
    """ADC range: lowest and highest value"""
    low_pass_hz: Annotated[float, Field(ge=1e-3, le=1e9)] | None = None
    """cut-off frequency (3 dB) of the low-pass before sampling"""
    low_pass: Literal["butterworth", "bessel"] = "butterworth"
    """kind of the low-pass"""
    low_pass_order: Annotated[int, Field(ge=1, le=HIGHEST_ORDER)] = 1
    """order of the low-pass"""
    ac_coupling_hz: Annotated[float, Field(ge=1e-6, le=1e9)] | None = None
    """corner of a first-order high-pass, as of a charge amplifier"""
    resonance_hz: Annotated[float, Field(ge=1.0, le=1e9)] | None = None
    """natural frequency of the sensor's own second-order response, as of a force cell"""
    resonance_damping: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    """damping of that response, of critical; default: 0.02"""
    noise_rms: Annotated[float, Field(ge=0.0, le=1e9)] = 0.0
    """standard deviation of the sensor noise, in the unit of the quantity"""
    fault: Literal["stuck", "offset", "spikes", "drop_outs", "saturation"] | None = None
    """fault of the sensor: it repeats one reading, adds an offset or spikes, repeats a reading in
    bursts, or cannot read beyond a size"""
    fault_start_s: Annotated[float, Field(ge=0.0, le=1e9)] | None = None
    """time at which the fault begins, from the start of the run; default: 0"""
    fault_duration_s: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    """length of the fault, or of a burst of drop_outs; default: to the end of the run, a burst one
    sample"""
    fault_size: Annotated[float, Field(ge=-1e9, le=1e9)] | None = None
    """offset, size of a spike, or largest reading either way, in the quantity's unit"""
    fault_probability: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """probability that a sample has a spike, or begins a burst of drop_outs; default: 0.01"""

    point_m: Point | None = None
    """point of the sensor on the plate, for plate quantities; default: the contact point"""

    @field_validator("low_pass", mode="before")
    @classmethod
    def _causal(cls, value: object) -> object:
        if value == "sigma-delta":
            raise ValueError(
                "sensors.low_pass = 'sigma-delta': its brick wall answers before its input comes, "
                "which a loop cannot. Give 'butterworth' or 'bessel', and its delay as "
                "controller.latency_us; a record may have it (record.low_pass)"
            )
        return value


class ActuatorTable(SceneTable):
    """The actuator between the signal path and the plate: natural frequency and damping (of
    critical) of a second-order response, mass that moves with the plate, largest force; left out:
    none of them."""

    bandwidth_hz: Annotated[float, Field(ge=1.0, le=1e9)] | None = None
    """natural frequency of the second-order actuator; default: ideal"""
    damping: Annotated[float, Field(ge=0.01, le=10.0)] = 0.7
    """damping ratio of the actuator"""
    mass_kg: Annotated[float, Field(ge=1e-6, le=1e3)] | None = None
    """actuator mass that moves with the plate; 0: none"""
    force_limit_n: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    """largest actuator force in either direction"""
    dead_time_us: Annotated[float, Field(ge=0.0, le=1e6)] | None = None
    """delay between command and force that the law does not know"""
    stuck_from_s: Annotated[float, Field(ge=0.0, le=1e9)] | None = None
    """time from which the actuator holds its force and ignores commands"""

    _no_mass = field_validator("mass_kg", mode="before")(_none_of_zero)


class RunTable(SceneTable):
    """Length, scheme, step, accuracy and seed. The run starts `lead_in_s` before the first
    contact. `plate_model`: the plate's modes, an infinite plate, or ("auto") the infinite one
    where the run is over before reflections matter at `accuracy`. `touch_phase`: part of a step
    from the last sample above the plate to the first touch, or "random", drawn by the seed."""

    PHASE_STREAM: ClassVar[int] = 4  # of random numbers; sensor and controller have others

    duration_s: Annotated[float, Field(gt=0.0, le=1e9)]
    """duration of the run"""
    scheme: SchemeName = "modal"
    """numerical scheme; "thesis2008": the scheme of the published study"""
    plate_model: Literal["auto", "modal", "infinite"] = "auto"
    """modes or an infinite plate; "auto": the cheaper one that meets run.accuracy"""
    lead_in_s: Annotated[float, Field(ge=0.0, le=1e3)] = 1e-3
    """time of flight before the first contact"""
    touch_phase: Annotated[float, Field(ge=0.0, le=1.0)] | Literal["random"] = 0.5
    """fraction of a step from the last sample in flight to first contact; "random": by seed"""
    step_ns: Annotated[int, Field(ge=1, le=1_000_000)] = 1000
    """time step"""
    accuracy: Annotated[float, Field(ge=1e-9, le=0.5)] = 1e-3
    """requested relative accuracy of the penetration; it selects the number of modes"""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    """random seed for noise, jitter and drop-outs"""

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return self.step_ns * 1e-9

    @property
    def phase(self) -> float:
        """Part of a step from the last sample above the plate to the first touch."""
        if self.touch_phase != "random":
            return self.touch_phase
        key = [self.seed, self.PHASE_STREAM]
        return float(np.random.Generator(np.random.Philox(key=key)).random())

    @property
    def step_us(self) -> float:
        """Length of a step, us."""
        return self.step_ns / 1000

    @property
    def steps(self) -> int:
        """Length of the run in steps."""
        return round(self.duration_s / self.step_s)

    def in_steps(self, time_us: float) -> int:
        """A time in whole steps."""
        return round(time_us * 1000 / self.step_ns)


class FitTable(SceneTable):
    """Where values of a scene come from: `hertzloop fit` writes it, and nothing else need. A run
    does not read it; `sweep --uncertain` draws from it."""

    keys: tuple[str, ...]
    """fitted keys"""
    values: tuple[float, ...]
    """their values"""
    low: tuple[float | Literal["open"], ...]
    """lower ends of the 95 % intervals"""
    high: tuple[float | Literal["open"], ...]
    """upper ends of the 95 % intervals"""
    verdicts: tuple[str, ...]
    """identified, one-sided, not identifiable or at its bound"""
    covariance_log: tuple[float, ...]
    """covariance of the natural logarithms of the values, row by row"""
    model: str
    """whether the class of models fits"""
    residual_over_noise: float
    """residual over noise"""
    records: tuple[str, ...]
    """names of the records"""
    sha256: tuple[str, ...]
    """digests of the records"""
    speeds_m_s: tuple[float, float]
    """lowest and highest impact speed of the records"""
