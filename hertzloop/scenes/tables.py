"""The tables of a scene and their keys: kinds, bounds and defaults."""

import re
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, field_validator

from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.registry import THEORIES
from hertzloop.scenes.errors import shown
from hertzloop.scenes.materials import MaterialKey, ModesTable, Table
from hertzloop.scenes.quantities import SENSED

Point = tuple[float, float]
# Bounds are far beyond what a laboratory has, and within what the numerics can carry.
Level = Annotated[float, Field(ge=-1e9, le=1e9)]
if TYPE_CHECKING:
    SchemeName = str
else:
    SchemeName = Literal[*SCHEMES]


class SphereTable(Table):
    """The falling sphere."""

    material: MaterialKey = "steel"
    """steel and the like: a name, or numbers"""
    radius_m: Annotated[float, Field(ge=1e-5, le=1.0)]
    """radius"""
    drop_height_m: Annotated[float, Field(ge=1e-7, le=100.0)]
    """height of its lowest point above the plate at the start of the fall"""


class PlateTable(Table):
    """The plate, the struck point and where the actuator pushes (default: the struck point).

    `edges`: c, f or s, clamped, free or simply supported, at x = 0, x = l_x, y = 0, y = l_y.
    `radiation`: how many faces radiate, each into a half space and as if in a baffle; air then
    damps the modes.
    `modes`: a file of modes in place of a plate; it says what is struck, so that `size_m` and
    `edges` mean nothing and `contact_point_m` serves the picture only. `thickness_m` is that of
    the plate that it is at the struck point, if it is one, `residual_flexibility_m_n` that of all
    modes not in the file. `tail`: the modes left out as a massless spring or as one damped mode;
    "auto" is "damped" where that is known. `theory`: Kirchhoff's thin plate, or the plate as a
    solid; "auto" is "kirchhoff" where that is expected to meet `run.accuracy`, or the other is not
    known.
    """

    material: MaterialKey
    """a name, or numbers"""
    size_m: (
        tuple[Annotated[float, Field(ge=0.01, le=20.0)], Annotated[float, Field(ge=0.01, le=20.0)]]
        | None
    ) = None
    """length and width"""
    thickness_m: Annotated[float, Field(ge=1e-5, le=1.0)] | None = None
    """thickness"""
    contact_point_m: Point | None = None
    """where it is struck, from a corner"""
    actuator_point_m: Point | None = None
    """where the actuator pushes; the struck point if left out"""
    loss_factor: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """of every mode; the material's if left out"""
    edges: str | None = None
    """a letter a side, at x = 0, x = l_x, y = 0, y = l_y: c clamped, s simply supported, f free;
    all s if left out"""
    radiation: Literal["none", "one_face", "two_faces"] | None = None
    """faces by which the modes lose energy to air; none if left out"""
    modes: ModesTable | None = None
    """a file of modes in the place of a plate (CSV, Parquet, NPZ)"""
    residual_flexibility_m_n: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """what the modes that are not in the file give to a static force"""
    tail: Literal["spring", "damped", "auto"] = "auto"
    """the modes left out as a massless spring or as one damped mode; "auto": damped where
    that is known"""
    theory: Literal[(*THEORIES, "auto")] = "kirchhoff"  # type: ignore[valid-type]
    """a thin plate or a solid; "auto": thin where that is expected to meet run.accuracy, or the
    other is not known"""

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

    @property
    def radiating_faces(self) -> int:
        """How many faces lose energy to air."""
        return {"one_face": 1, "two_faces": 2}.get(self.radiation or "none", 0)

    @property
    def points_m(self) -> tuple[Point, Point]:
        """Struck point and actuator's point; the corner where modes say what is struck."""
        contact = self.contact_point_m or (0.0, 0.0)
        return contact, self.actuator_point_m or contact


class ContactTable(Table):
    """Damping inside the contact; `relaxation_*` are s_tau (N/m^1.5), tau (s) and the solve.
    `plasticity` "thornton": the contact yields where the pressure reaches the limiting one, between
    1.6 times the softer body's yield strength and its hardness; left out, it is that hardness, or
    2.8 times the yield strength of a material that has no hardness."""

    damping: Literal["none", "viscous", "hunt_crossley", "relaxation"] = "none"
    """damper beside the contact spring"""
    viscous_n_s_m: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    """constant of viscous damping"""
    restitution: Annotated[float, Field(ge=1e-3, le=1.0)] = 1.0
    """of Hunt-Crossley damping, on a massive body"""
    relaxation_stiffness: Annotated[float, Field(ge=0.0, le=1e15)] = 0.0
    """s_tau of relaxation damping, N/m^1.5"""
    relaxation_s: Annotated[float, Field(ge=1e-9, le=1e3)] = 1e-3
    """time constant of relaxation damping"""
    relaxation_solve: Literal["published", "bracketed"] = "bracketed"
    """the published iteration, or a bracketed one with the memory as a state"""
    plasticity: Literal["none", "thornton"] = "none"
    """elastic, or Thornton's contact that yields"""
    limiting_pressure_pa: Annotated[float, Field(ge=1e3, le=1e13)] | None = None
    """pressure at which it yields"""
    stiffness_factor: Annotated[float, Field(ge=1e-2, le=1e2)] | None = None
    """factor on the stiffness of Hertz's contact, as of a fit; 1 if left out"""


class SensorsTable(Table):
    """Data acquisition. `quantity` "auto", or left out, becomes what the law works on;
    `full_scale` is lowest and highest value, "auto", which for the gap holds the flight that a law
    has to see, "contact", which does not, or "none"."""

    quantity: Literal[(*SENSED, "auto")] = "auto"  # type: ignore[valid-type]
    """what is sampled; "auto" is what the law works on"""
    every_steps: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    """sampling period"""
    bits: Annotated[int, Field(ge=1, le=24)] | Literal["ideal"] = "ideal"
    """of the converter"""
    full_scale: tuple[Level, Level] | Literal["auto", "contact", "none"] = "auto"
    """lowest and highest value of the converter"""
    low_pass_hz: Annotated[float, Field(ge=1e-3, le=1e9)] | None = None
    """first-order low-pass before sampling"""
    ac_coupling_hz: Annotated[float, Field(ge=1e-6, le=1e9)] | None = None
    """corner of AC coupling, a first-order high-pass; none if left out"""
    resonance_hz: Annotated[float, Field(ge=1.0, le=1e9)] | None = None
    """natural frequency of the sensor's own second-order response, as of a force cell"""
    resonance_damping: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    """damping of that response, of critical; 0.02 if left out"""
    noise_rms: Annotated[float, Field(ge=0.0, le=1e9)] = 0.0
    """standard deviation of the noise, in the quantity's unit"""
    fault: Literal["stuck", "offset", "spikes", "drop_outs", "saturation"] | None = None
    """fault of the sensor: it repeats one reading, adds an offset, adds spikes to some samples,
    repeats a reading in bursts, or cannot read beyond a size; none if left out"""
    fault_start_s: Annotated[float, Field(ge=0.0, le=1e9)] | None = None
    """time at which the fault begins, from the start of the run; 0 if left out"""
    fault_duration_s: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    """length of the fault, or of a burst of drop_outs (default: one sample); to the end of the run
    if left out"""
    fault_size: Annotated[float, Field(ge=-1e9, le=1e9)] | None = None
    """offset, size of a spike, or largest reading either way, in the quantity's unit"""
    fault_probability: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """probability that a sample has a spike, or begins a burst of drop_outs; 0.01 if left out"""

    @property
    def has_fault_keys(self) -> bool:
        """Whether a key of a fault is given beside its kind."""
        keys = (self.fault_start_s, self.fault_duration_s, self.fault_size, self.fault_probability)
        return any(key is not None for key in keys)


class ActuatorTable(Table):
    """The actuator between the controller's line and the plate: natural frequency and damping (of
    critical) of a second-order response, mass that moves with the plate, largest force; left
    out: none of them."""

    bandwidth_hz: Annotated[float, Field(ge=1.0, le=1e9)] | None = None
    """natural frequency of its second-order response; ideal if left out"""
    damping: Annotated[float, Field(ge=0.01, le=10.0)] = 0.7
    """of critical, of that response"""
    mass_kg: Annotated[float, Field(ge=1e-6, le=1e3)] | None = None
    """mass that moves with the plate; 0 is none"""
    force_limit_n: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    """largest force, either way"""
    dead_time_us: Annotated[float, Field(ge=0.0, le=1e6)] | None = None
    """delay between command and force that the law does not know; none if left out"""
    stuck_from_s: Annotated[float, Field(ge=0.0, le=1e9)] | None = None
    """time from which the actuator holds its force and ignores commands; never if left out"""

    @field_validator("mass_kg", mode="before")
    @classmethod
    def _none(cls, value: object) -> object:
        """No mass is none: a sweep over it may begin there."""
        return None if value == 0 and not isinstance(value, bool) else value


class RunTable(Table):
    """Length, scheme, step, accuracy and seed. The run starts `lead_in_s` before the first
    contact. `plate_model`: the plate's modes, an infinite plate, or ("auto") the infinite one
    where the run is over before reflections matter at `accuracy`. `touch_phase`: part of a step
    from the last sample above the plate to the first touch, or "random", drawn by the seed."""

    duration_s: Annotated[float, Field(gt=0.0, le=1e9)]
    """length"""
    scheme: SchemeName = "modal"
    """how a step is solved; "thesis2008" is the published study"""
    plate_model: Literal["auto", "modal", "infinite"] = "auto"
    """modes, an infinite plate, or whichever does"""
    lead_in_s: Annotated[float, Field(ge=0.0, le=1e3)] = 1e-3
    """flight before the first contact"""
    touch_phase: Annotated[float, Field(ge=0.0, le=1.0)] | Literal["random"] = 0.5
    """part of a step from the last sample above the plate to the touch; "random" by the seed"""
    step_ns: Annotated[int, Field(ge=1, le=1_000_000)] = 1000
    """length of a step"""
    accuracy: Annotated[float, Field(ge=1e-9, le=0.5)] = 1e-3
    """error of the gap, relative, that the choice of modes may make"""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    """of noise, jitter and drop-outs"""


class FitTable(Table):
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
    """identified, one-sided or not identifiable"""
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
