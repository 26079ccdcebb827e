"""Scenes: what is simulated, as one TOML file, checked before anything runs."""

import base64
import binascii
import copy
import difflib
import hashlib
import math
import re
import shlex
import tomllib
import unicodedata
import zlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import lru_cache
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self, cast, get_args

import numpy as np
import tomli_w
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo

from hertzloop.controller.law import WHOLE_STEPS
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.registry import (
    NO_CONTROL,
    find,
    read_again,
    resolve,
    shipped_keys,
)
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.plant.contact.hertz import HERTZ
from hertzloop.plant.schemes.registry import SCHEMES, supporting
from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.materials import (
    MATERIALS,
    SHIPPED,
    Material,
    material_of,
    materials_of,
)
from hertzloop.plant.structures.mode_file import SUFFIXES, read_modes
from hertzloop.plant.structures.registry import STRUCTURES, THEORIES
from hertzloop.scenes.errors import (
    LONGEST,
    SceneError,
    refused,
    sentence,
    shortened,
    shown,
    table_at,
    unknown_key,
)
from hertzloop.scenes.quantities import SENSED
from hertzloop.sensors.acquisition import HIGHEST_ORDER
from hertzloop.text_files import text_of
from hertzloop.text_tables import TableError, read_table
from hertzloop.units import name_and_unit, plain_name, unit_of

_MOST_BYTES = 64 << 20  # of a file of modes, unpacked


def unpacked(file: str, sha256: str, content: str) -> bytes:
    """The bytes of a file of modes as a scene holds it. Raises ValueError if they are damaged."""
    try:
        opener = zlib.decompressobj()
        found = opener.decompress(base64.b64decode(content, validate=True), _MOST_BYTES)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(f"plate.modes.content of {file} is damaged: {error}") from error
    if hashlib.sha256(found).hexdigest() != sha256:
        raise ValueError(f"plate.modes.content of {file} is not what plate.modes.sha256 says")
    return found


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

    def replaced(self, **values: Any) -> Self:
        """Return a copy with other values that are checked already. `model_copy` does the same in
        ten times as long, which counts where cases are made by the thousand."""
        new = type(self).__new__(type(self))
        object.__setattr__(new, "__dict__", vars(self) | values)
        object.__setattr__(new, "__pydantic_fields_set__", self.__pydantic_fields_set__)
        object.__setattr__(new, "__pydantic_extra__", self.__pydantic_extra__)
        object.__setattr__(new, "__pydantic_private__", self.__pydantic_private__)
        return new

    def __hash__(self) -> int:
        """Kept: what many scenes share is looked up by its tables again and again."""
        found: int | None = getattr(self, "_hash", None)
        if found is None:
            found = hash((type(self), *vars(self).values()))
            object.__setattr__(self, "_hash", found)
        return found


class MaterialTable(SceneTable):
    """A material by its numbers; `plant.structures.materials` says which can be. `name`, in a
    list of materials, is what plate.material, sphere.material and hammer.tip_material
    may say."""

    name: str | None = None
    young_pa: float | None = None
    density_kg_m3: float
    poisson: float | None = None
    young_x_pa: float | None = None
    young_y_pa: float | None = None
    young_z_pa: float | None = None
    shear_pa: float | None = None
    poisson_xy: float | None = None
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


def numbers_of_material(table: Mapping[str, Any]) -> dict[str, Any]:
    """A material's table without its name."""
    return {key: value for key, value in table.items() if key != "name" and value is not None}


@lru_cache(maxsize=64)
def material_called(given: MaterialKey, own: tuple[MaterialTable, ...]) -> Material:
    """A material by its numbers or its name, of the scene's own first."""
    if isinstance(given, str):
        named = next((table for table in own if table.name == given), None)
        if named is None:
            return MATERIALS[given]
        given = named
    return material_of("material", numbers_of_material(given.model_dump()))


def _none_of_zero(value: object) -> object:
    """No mass is none: a sweep over it may begin there."""
    return None if value == 0 and not isinstance(value, bool) else value


# The tables and their keys: kinds, bounds and defaults.

Point = tuple[float, float]
# Bounds are far beyond what a laboratory has, and within what the numerics can carry.
Level = Annotated[float, Field(ge=-1e9, le=1e9)]
if TYPE_CHECKING:
    SchemeName = str
else:
    SchemeName = Literal[*SCHEMES]


Mass = Annotated[float, Field(ge=1e-9, le=1e4)]
Speed = Annotated[float, Field(ge=1e-3, le=45.0)]
Radius = Annotated[float, Field(ge=1e-5, le=1.0)]


class SphereTable(SceneTable):
    """The falling sphere. `mass_kg` stands in for the density of its material, `speed_m_s` for
    `drop_height_m`."""

    material: MaterialKey = "steel"
    """sphere material: a name, or numbers"""
    radius_m: Radius
    """sphere radius"""
    drop_height_m: Annotated[float, Field(ge=1e-7, le=100.0)] | None = None
    """drop height of the lowest point of the sphere above the plate"""
    mass_kg: Mass | None = None
    """sphere mass; default: by the density of its material"""
    speed_m_s: Speed | None = None
    """impact speed, in place of the drop height"""


class HammerTable(SceneTable):
    """An impact hammer in place of the sphere. It moves without weight, and a hand withdraws it
    after the first contact unless it `bounces`. The contact force is Hertz's, by radius and
    material of the tip, or `tip_stiffness` times the penetration to the power of `tip_exponent`."""

    mass_kg: Mass
    """mass of head, tip and the part of the handle that moves with them"""
    speed_m_s: Speed
    """speed at the hit"""
    tip_radius_m: Radius | None = None
    """radius of the tip, of a Hertz contact"""
    tip_material: MaterialKey = "steel"
    """tip material: a name, or numbers"""
    tip_stiffness: Annotated[float, Field(ge=1.0, le=1e15)] | None = None
    """contact stiffness of the tip, N/m^tip_exponent, in place of its radius"""
    tip_exponent: Annotated[float, Field(ge=1.0, le=2.0)] | None = None
    """exponent of the contact force: 1 of a soft tip, 1.5 of Hertz's contact"""
    bounces: bool = False
    """whether later contacts count; false: it is withdrawn after the first"""

    @property
    def material(self) -> MaterialKey:
        """That of the tip."""
        return self.tip_material


Striker = SphereTable | HammerTable


class PlateTable(SceneTable):
    """The plate, the contact point and the actuator point (default: the contact point).

    `edges`: c, f or s, clamped, free or simply supported, at x = 0, x = l_x, y = 0, y = l_y.
    `radiation`: how many faces radiate, each into a half space and as if in a baffle; air then
    damps the modes.
    `modes`: a file of modes that replaces the plate. It defines the structure, so that `size_m` and
    `edges` have no effect and `contact_point_m` serves the picture only. `thickness_m` is that of
    the plate at the contact point, if it is one; `residual_flexibility_m_n` is that of all modes
    not in the file. `tail`: the truncated modes as a massless spring or as one damped mode;
    "auto" is "damped" where that is known. `theory`: Kirchhoff's thin plate, or the plate as a
    solid; "auto" is "kirchhoff" where that is expected to meet `run.accuracy`, or the other is not
    known.
    """

    material: MaterialKey
    """plate material: a name, or numbers"""
    size_m: (
        tuple[Annotated[float, Field(ge=0.01, le=20.0)], Annotated[float, Field(ge=0.01, le=20.0)]]
        | None
    ) = None
    """plate length and width"""
    thickness_m: Annotated[float, Field(ge=1e-5, le=1.0)] | None = None
    """plate thickness"""
    contact_point_m: Point | None = None
    """contact point, measured from a corner"""
    actuator_point_m: Point | None = None
    """actuator point; default: the contact point"""
    loss_factor: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """loss factor of every mode; default: that of the material"""
    edges: str | None = None
    """edge conditions at x = 0, x = l_x, y = 0, y = l_y: c clamped, s simply supported, f free;
    default: ssss"""
    radiation: Literal["none", "one_face", "two_faces"] | None = None
    """faces that radiate into air; default: none"""
    modes: ModesTable | None = None
    """file of modes that replaces the plate (CSV, Parquet, NPZ)"""
    residual_flexibility_m_n: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """static flexibility of the modes that are not in the file"""
    tail: Literal["spring", "damped", "auto"] = "auto"
    """model of the truncated modes: massless spring or one damped mode; "auto": damped where
    that is known"""
    theory: Literal[(*THEORIES, "auto")] = "kirchhoff"  # type: ignore[valid-type]
    """plate theory: thin plate or solid; "auto": thin plate where it meets run.accuracy or the
    solid is not available"""

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
        """Contact point and actuator point; the corner if a file of modes defines the structure."""
        contact = self.contact_point_m or (0.0, 0.0)
        return contact, self.actuator_point_m or contact


class ContactTable(SceneTable):
    """Damping inside the contact; `relaxation_*` are s_tau (N/m^1.5), tau (s) and the solve.
    `plasticity` "thornton": the contact yields where the pressure reaches the limiting one, between
    1.6 times the softer body's yield strength and its hardness; left out, it is that hardness, or
    2.8 times the yield strength of a material that has no hardness."""

    damping: Literal["none", "viscous", "hunt_crossley", "relaxation"] = "none"
    """damping model of the contact"""
    viscous_n_s_m: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    """viscous damping constant; the damper also pulls while the bodies separate"""
    restitution: Annotated[float, Field(ge=1e-3, le=1.0)] = 1.0
    """coefficient of restitution of Hunt-Crossley damping on a massive body, at the speed of the
    first impact; later, slower impacts are damped less"""
    relaxation_stiffness: Annotated[float, Field(ge=0.0, le=1e15)] = 0.0
    """stiffness s_tau of relaxation damping, N/m^1.5"""
    relaxation_s: Annotated[float, Field(ge=1e-9, le=1e3)] = 1e-3
    """time constant of relaxation damping"""
    relaxation_solve: Literal["published", "bracketed"] = "bracketed"
    """solver of relaxation damping: the published iteration or a bracketed one"""
    plasticity: Literal["none", "thornton"] = "none"
    """plasticity of the contact: none, or the model of Thornton"""
    limiting_pressure_pa: Annotated[float, Field(ge=1e3, le=1e13)] | None = None
    """limiting contact pressure at yield"""
    stiffness_factor: Annotated[float, Field(ge=1e-2, le=1e2)] | None = None
    """factor on the stiffness of Hertz's contact, as of a fit; 1 if left out"""


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
    """cut-off frequency (3 dB) of the low-pass before sampling; none if left out"""
    low_pass: Literal["butterworth", "bessel"] = "butterworth"
    """kind of the low-pass"""
    low_pass_order: Annotated[int, Field(ge=1, le=HIGHEST_ORDER)] = 1
    """order of the low-pass"""
    ac_coupling_hz: Annotated[float, Field(ge=1e-6, le=1e9)] | None = None
    """corner of a first-order high-pass, as of a charge amplifier; none if left out"""
    resonance_hz: Annotated[float, Field(ge=1.0, le=1e9)] | None = None
    """natural frequency of the sensor's own second-order response, as of a force cell"""
    resonance_damping: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    """damping of that response, of critical; 0.02 if left out"""
    noise_rms: Annotated[float, Field(ge=0.0, le=1e9)] = 0.0
    """standard deviation of the sensor noise, in the unit of the quantity"""
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

    point_m: Point | None = None
    """point of the sensor on the plate, for plate quantities; default: the contact point"""
    mass_kg: Annotated[float, Field(ge=1e-7, le=1e3)] | None = None
    """mass of the sensor, which moves with the plate at its point; 0: none"""

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

    _no_mass = field_validator("mass_kg", mode="before")(_none_of_zero)


class ActuatorTable(SceneTable):
    """The actuator between the controller's line and the plate: natural frequency and damping (of
    critical) of a second-order response, mass that moves with the plate, largest force; left
    out: none of them."""

    bandwidth_hz: Annotated[float, Field(ge=1.0, le=1e9)] | None = None
    """natural frequency of the second-order actuator; default: ideal"""
    damping: Annotated[float, Field(ge=0.01, le=10.0)] = 0.7
    """damping ratio of the actuator"""
    mass_kg: Annotated[float, Field(ge=1e-6, le=1e3)] | None = None
    """actuator mass that moves with the plate; 0: none"""
    force_limit_n: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    """largest actuator force in either direction"""
    dead_time_us: Annotated[float, Field(ge=0.0, le=1e6)] | None = None
    """delay between command and force that the law does not know; none if left out"""
    stuck_from_s: Annotated[float, Field(ge=0.0, le=1e9)] | None = None
    """time from which the actuator holds its force and ignores commands; never if left out"""

    _no_mass = field_validator("mass_kg", mode="before")(_none_of_zero)


class RunTable(SceneTable):
    """Length, scheme, step, accuracy and seed. The run starts `lead_in_s` before the first
    contact. `plate_model`: the plate's modes, an infinite plate, or ("auto") the infinite one
    where the run is over before reflections matter at `accuracy`. `touch_phase`: part of a step
    from the last sample above the plate to the first touch, or "random", drawn by the seed."""

    duration_s: Annotated[float, Field(gt=0.0, le=1e9)]
    """duration of the run"""
    scheme: SchemeName = "modal"
    """numerical scheme; "thesis2008": the scheme of the published study"""
    plate_model: Literal["auto", "modal", "infinite"] = "auto"
    """plate model: modes or an infinite plate; "auto": the cheaper one that meets run.accuracy"""
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


# Laws of checked tables by reference and digest: a case asks for its law a dozen times.
_CHECKED: dict[tuple[str, str], Law] = {}
_MOST_CHECKED = 64


class ControllerTable(SceneTable):
    """The law, the line to the actuator, and the law's own keys.

    `law`: a shipped name, "mine.py", "mine.py:Name", "package.module:Name", an entry point's name,
    "mine.so" or "mine.fmu". A key that the law does not have is refused, unless it has the default
    of the shipped laws that have it.
    `law_digest`: of a law that is not shipped; one with another digest is refused.
    """

    model_config = ConfigDict(extra="allow")

    law: str = "slope_threshold"
    """control law: a shipped name, a file (mine.py, mine.py:Name), package.module:Name, an entry
    point, a library (mine.so), or a co-simulation unit (mine.fmu)"""
    law_digest: str | None = None
    """required digest of a law that is not shipped"""
    latency_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    """latency in addition to one step"""
    latency_trace: tuple[Annotated[float, Field(ge=0.0, le=1e6)], ...] | None = None
    """latencies by sample, us, for latency_us: a CSV file, a paced recording, a list, or a table
    with median_us, sigma, autocorrelation; repeated, in whole steps; commands keep their order"""
    latency_trace_use: Literal["replay", "resample"] | None = None
    """replay the trace as it is (default), or resample blocks of it by the seed"""
    jitter_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    """largest random addition to the latency; commands keep their order, so that 20 us of jitter
    make the force 15.6 us older on average"""
    drop_out_probability: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    """probability that a command drops out; the last command is then held"""
    bits: Annotated[int, Field(ge=2, le=24)] | Literal["ideal"] = "ideal"
    """DAC resolution, bits"""
    full_scale_n: Annotated[float, Field(ge=1e-9, le=1e9)] | None = None
    """largest force of the DAC in either direction"""
    slew_n_s: Annotated[float, Field(ge=1e-9, le=1e15)] | None = None
    """slew rate limit of the force"""

    @property
    def found(self) -> Law:
        """The law; on the disk it is looked for, and its digest compared, when a table is checked.
        Raises LawError."""
        known = _CHECKED.get((self.law, self.law_digest or ""))
        return known or find(self.law, self.law_digest)

    @property
    def keys(self) -> Any:
        """The law's own keys."""
        given = self.__pydantic_extra__ or {}
        own = self.found.key_names
        return SimpleNamespace(**{name: given[name] for name in own if name in given})

    @model_validator(mode="after")
    def _keys_of_laws(self, info: ValidationInfo) -> "ControllerTable":
        """Check the law's keys, fill in its defaults, drop keys of other laws at their default."""
        given = self.__pydantic_extra__
        assert given is not None
        try:
            law = find(self.law, self.law_digest)
        except LawError as error:
            if is_recorded(info):
                return self
            raise ValueError(str(error)) from error
        own = law.keys.model_fields
        if taken := [name for name in own if name in ControllerTable.model_fields]:
            raise ValueError(
                f"controller.law = '{self.law}': its key {taken[0]} is a key of the control loop. "
                "Rename it in the law."
            )
        for name, value in given.items():
            if name in own:
                continue
            others = shipped_keys()
            if name not in others:
                known = [*ControllerTable.model_fields, *own]
                raise ValueError(unknown_key(("controller", name), known))
            if value != others[name].default and not is_recorded(info):
                raise ValueError(_of_another_law(name, value, law))
        try:
            mine = law.keys.model_validate({k: v for k, v in given.items() if k in own})
        except ValidationError as error:
            raise ValueError(_sentence_of(error, own)) from error
        given.clear()
        given.update(vars(mine))
        if law.name not in shipped_laws():
            self.__dict__["law_digest"] = law.digest
            if len(_CHECKED) >= _MOST_CHECKED:
                _CHECKED.clear()
            _CHECKED[self.law, law.digest] = law
        return self


@lru_cache(maxsize=64)
def _switched_off(table: ControllerTable) -> ControllerTable:
    line: dict[str, Any] = {name: getattr(table, name) for name in ControllerTable.model_fields}
    line |= {"law": NO_CONTROL, "law_digest": None}
    return ControllerTable.model_construct(**line)


def is_recorded(info: ValidationInfo) -> bool:
    """Whether a scene is read from a recording, which may outlive its law."""
    return bool(info.context and info.context.get("recorded"))


def law_key(table: ControllerTable, name: str) -> FieldInfo | None:
    """What is known of a key: the line's, the law's, or a shipped law's."""
    for fields in (ControllerTable.model_fields, table.found.keys.model_fields, shipped_keys()):
        if name in fields:
            return fields[name]
    return None


def _of_another_law(name: str, value: Any, law: Law) -> str:
    """Sentence on a key of a shipped law that the chosen law does not have."""
    keys = ", ".join(law.keys.model_fields) or "none"
    having = ", ".join(n for n in shipped_laws() if name in find(n).keys.model_fields)
    return (
        f"controller.{name} = {shown(value)}: has no effect on controller.law = '{law.name}', "
        f"whose keys are: {keys}. Leave the key out, or choose a law that has it: {having}"
    )


def _sentence_of(error: ValidationError, fields: Mapping[str, FieldInfo]) -> str:
    """On the first problem with one of several keys."""
    problem = error.errors()[0]
    if problem["type"] == "value_error":
        return str(problem["ctx"]["error"])
    key = str(problem["loc"][0])
    same = [p for p in error.errors() if p["loc"][:1] == problem["loc"][:1]]
    return refused(("controller", key), problem["input"], same, fields[key])


def switch_law(data: dict[str, Any], name: str, written: bool = False) -> None:
    """Put another law into a table, and drop what belongs to the old one alone: its digest, and
    keys that the new law does not have. Keys that the old law has by default are dropped as well,
    unless they are `written` in a file. Raises LawError."""
    fields = find(name).keys.model_fields
    digest = data.pop("law_digest", None)
    old = {}
    try:
        old = find(
            str(data.get("law", ControllerTable.model_fields["law"].default)), digest
        ).keys.model_fields
        of_old = set(old)
    except LawError:  # a recording may outlive its law
        of_old = set(data)
    for key in of_old & data.keys() - ControllerTable.model_fields.keys():
        is_default = key in old and data[key] == old[key].default
        if key not in fields or (is_default and not written):
            del data[key]
    data["law"] = name


_MAX_STEPS = 20_000_000
_EDGE = 1e-4  # of a side; nearer to it a point force moves no mode by more than rounding
_MIDDLE = 0.5  # touch phase of a run that says nothing else
_NARROWEST = 1e-12  # range of a converter, in the unit of its quantity
_NARROWEST_SHARE = 1e-6  # of its larger number; 24 bits of it are still told apart


class _Uncontrolled(NamedTuple):
    """The tables of a scene that are neither sensor nor controller."""

    sphere: SphereTable | None
    hammer: HammerTable | None
    plate: PlateTable
    contact: ContactTable
    actuator: ActuatorTable
    materials: tuple[MaterialTable, ...] | None
    run: RunTable
    sensor_point_m: tuple[float, float] | None
    sensor_mass_kg: float | None


def problems(scene: "Scene") -> list[str]:
    """Sentences on values that are fine alone, but not together."""
    found = []
    run, control, sensors = scene.run, scene.controller, scene.sensors
    tables = _Uncontrolled(
        scene.sphere, scene.hammer, scene.plate, scene.contact, scene.actuator, scene.materials,
        run, sensors.point_m, sensors.mass_kg,
    )  # fmt: skip
    of_plate, of_run = _beside_control(tables)
    found += of_plate
    found += _line_problems(control, scene.actuator, run, tuple(scene.whole_step_keys()))
    quantity = SENSED[sensors.quantity]
    if sensors.point_m is not None and sensors.mass_kg is quantity.elsewhere is None:
        found.append(
            f"sensors.point_m = {list(sensors.point_m)}: sensors.quantity = "
            f"'{sensors.quantity}' is one of the contact. Remove the key, or use 'v_p' or "
            "'acceleration'."
        )
    shaped = sensors.low_pass != "butterworth" or sensors.low_pass_order > 1
    if sensors.low_pass_hz is None and shaped:
        found.append("sensors.low_pass_hz: is missing beside its kind or order. Give the corner")
    beside = [key for key, value in sensors if key.startswith("fault_") and value is not None]
    if sensors.fault is None and beside:
        found.append("sensors.fault: is missing beside other keys of a fault. Say which fault")
    if sensors.fault in ("offset", "spikes", "saturation") and sensors.fault_size is None:
        found.append(
            f"sensors.fault = '{sensors.fault}': needs sensors.fault_size, in the unit of "
            "sensors.quantity. Give a number"
        )
    wanted = scene.law.senses
    several = [one.strip() for one in wanted.split(",")]
    if not {*several} <= {*SENSED, "any"}:
        found.append(
            f"{scene.law.name}: senses = '{wanted}' is unknown. Use any, {', '.join(SENSED)}."
        )
    elif "any" not in several and sensors.quantity not in several:
        found.append(
            f"sensors.quantity = '{sensors.quantity}': controller.law = '{control.law}' needs "
            f"'{wanted}'. Use '{wanted}' or 'auto'."
        )
    found += of_run
    if control.bits != "ideal" and control.full_scale_n is None:
        found.append(
            f"controller.bits = {control.bits}: needs the largest force. Give "
            "controller.full_scale_n in N."
        )
    limits = sensors.full_scale
    if isinstance(limits, tuple):
        if not limits[0] < limits[1]:
            found.append(
                f"sensors.full_scale = {list(limits)}: the first number must be the lower one. "
                "Swap or change them."
            )
        elif limits[1] - limits[0] < max(_NARROWEST, _NARROWEST_SHARE * max(map(abs, limits))):
            found.append(
                f"sensors.full_scale = {list(limits)}: the range is too narrow. Use at least "
                f"{_NARROWEST:g}, and {_NARROWEST_SHARE:g} of the larger number."
            )
    if sensors.bits != "ideal" and limits == "none":
        found.append(
            f"sensors.bits = {sensors.bits}: needs a range. Set sensors.full_scale, not 'none'."
        )
    return found


@lru_cache(maxsize=64)
def _line_problems(
    control: ControllerTable, actuator: ActuatorTable, run: RunTable,
    whole_step_keys: tuple[str, ...],
) -> list[str]:  # fmt: skip
    """Of the length of the run, and of the line from law to actuator in it."""
    found, steps, in_steps = [], run.steps, run.in_steps
    if not 1 <= steps <= _MAX_STEPS:
        found.append(
            f"run.duration_s = {run.duration_s:g} gives {steps} steps of run.step_ns = "
            f"{run.step_ns}. A run has 1 to {_MAX_STEPS} steps; change one of the two."
        )
    for key in whole_step_keys:
        value = getattr(control, key)
        if abs(value * 1000 / run.step_ns - in_steps(value)) > 1e-9 * max(1.0, value):
            found.append(
                f"controller.{key} = {value:g}: must be a whole number of steps. Give a multiple "
                f"of {run.step_ns / 1000:g} us (run.step_ns = {run.step_ns})."
            )
    late = control.latency_us > 0.0 and in_steps(control.latency_us) + 1 >= steps
    if control.law != NO_CONTROL and late:
        found.append(
            f"controller.latency_us = {control.latency_us:g}: is as long as the run, so no force "
            f"acts. Reduce it or increase run.duration_s (now {run.duration_s:g})."
        )
    if control.latency_trace is not None and control.latency_us != 0.0:
        found.append(
            f"controller.latency_us = {control.latency_us:g}: has no effect beside "
            "controller.latency_trace. Leave one of them out"
        )
    dead_us = actuator.dead_time_us or 0.0
    if abs(dead_us * 1000 / run.step_ns - in_steps(dead_us)) > 1e-9 * max(1.0, dead_us):
        found.append(
            f"actuator.dead_time_us = {dead_us:g}: must be a whole number of steps. Give a "
            f"multiple of {run.step_ns / 1000:g} us"
        )
    return found


@lru_cache(maxsize=64)
def _beside_control(scene: _Uncontrolled) -> tuple[list[str], list[str]]:
    """Of the plate alone, and of the run with all that is neither sensor nor controller."""
    of_plate = _structure_problems(scene) + _point_problems(scene.plate, scene.sensor_point_m)
    of_striker = _striker_problems(scene)
    if of_striker:  # what else there is may follow from it
        return of_striker, []
    return of_plate, _phase_problems(scene) + _scheme_problems(scene) + unread(scene)


def _striker_problems(scene: _Uncontrolled) -> list[str]:
    """What a scene says of the sphere or the hammer that does not make one striker."""
    sphere, hammer = scene.sphere, scene.hammer
    if (sphere is None) == (hammer is None):
        said = "no table" if sphere is None else "two tables"
        return [f"[sphere] and [hammer]: {said} of what strikes the plate. Give one of the two."]
    striker = sphere or hammer
    assert striker is not None
    if material_called(striker.material, scene.materials or ()).orthotropic:
        key = "sphere.material" if sphere is not None else "hammer.tip_material"
        return [f"{key}: is orthotropic, which a plate alone can be. Use an isotropic material."]
    if sphere is not None:
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
    assert hammer is not None
    radius, stiffness, exponent = hammer.tip_radius_m, hammer.tip_stiffness, hammer.tip_exponent
    if radius is not None and stiffness is not None:
        return [
            f"hammer.tip_radius_m = {radius:g} and hammer.tip_stiffness = {stiffness:g}: both "
            "give the contact force. Leave one out."
        ]
    if (stiffness is None) != (exponent is None):
        return [
            "hammer.tip_stiffness and hammer.tip_exponent: one says nothing without the other, "
            "because the unit of the stiffness is N/m^exponent. Give both, or hammer.tip_radius_m."
        ]
    if radius is stiffness is None:
        return [
            "hammer.tip_radius_m: is missing from the scene. Add it, or hammer.tip_stiffness and "
            "hammer.tip_exponent."
        ]
    return _hammer_problems(scene, hammer)


def _hammer_problems(scene: _Uncontrolled, hammer: HammerTable) -> list[str]:
    stiffness, exponent = hammer.tip_stiffness, hammer.tip_exponent
    found = _needs("supports_hammer", scene.run.scheme, "modal", "[hammer]")
    if exponent not in (None, HERTZ):
        found += _needs(
            "supports_exponent", scene.run.scheme, "modal", f"hammer.tip_exponent = {exponent:g}"
        )
    if stiffness is not None and scene.contact.plasticity != "none":
        found.append(
            f"contact.plasticity = '{scene.contact.plasticity}': needs the radius of the tip, "
            f"which hammer.tip_stiffness = {stiffness:g} does not give. Give hammer.tip_radius_m."
        )
    return found


def _phase_problems(scene: _Uncontrolled) -> list[str]:
    """A touch phase of a run that does not begin in flight, or counts whole steps only."""
    run = scene.run
    if run.touch_phase == _MIDDLE:
        return []
    phase = f"run.touch_phase = {run.touch_phase!r}"
    fall_s = math.inf
    if scene.sphere is not None:
        height_m, speed_m_s = scene.sphere.drop_height_m, scene.sphere.speed_m_s
        if height_m is None:
            assert speed_m_s is not None  # see `_striker_problems`
            height_m = speed_m_s**2 / (2.0 * GRAVITY_M_S2)
        fall_s = math.sqrt(2.0 * height_m / GRAVITY_M_S2)
    if refusal := _needs("supports_touch_phase", run.scheme, "modal", phase):
        return refusal
    if not run.step_s <= run.lead_in_s < fall_s - run.step_s:
        return [
            f"{phase}: the run must begin in flight. Set run.lead_in_s (now {run.lead_in_s:g}) to "
            f"at least a step and less than the time to the contact, {fall_s:.3g} s."
        ]
    return []


def _sensor_problems(scene: _Uncontrolled) -> list[str]:
    """What does not go with a sensor elsewhere, or with a mass."""
    point, mass = scene.sensor_point_m, scene.sensor_mass_kg
    found: list[str] = []
    for key, value in (("point_m", point), ("mass_kg", mass)):
        if value is not None:
            asked = f"sensors.{key} = {list(value) if isinstance(value, tuple) else f'{value:g}'}"
            found += _needs(
                "supports_sensor_elsewhere", scene.run.scheme, scene.run.plate_model, asked
            )
    if point is not None and scene.plate.modes is not None:
        found.append(
            f"sensors.point_m = {list(point)}: plate.modes of {scene.plate.modes.file} know points "
            "by their columns only. Remove the key, and give the file a column shape_sensor."
        )
    return found


def _point_problems(plate: PlateTable, sensor_point_m: tuple[float, float] | None) -> list[str]:
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


def _beyond_simply_supported(scene: _Uncontrolled) -> list[str]:
    """What is known of a simply supported plate only."""
    plate, found = scene.plate, []
    if plate.modes is not None:
        key, words = "plate.modes", f"plate.modes of {plate.modes.file}"
    elif plate.edges not in (None, "ssss"):
        key, words = "plate.edges", f"plate.edges = '{plate.edges}'"
    elif material_called(plate.material, scene.materials or ()).orthotropic:
        key, words = "plate.material", f"{_plate_in_words(scene)}, which is orthotropic"
    else:
        return []
    if plate.radiating_faces:
        found.append(
            f"{words}: plate.radiation = '{plate.radiation}' supports a simply supported plate "
            "only. Remove one of the two."
        )
    if not SCHEMES[scene.run.scheme].supports_edges:
        found.append(
            f"{words}: run.scheme = '{scene.run.scheme}' supports a simply supported plate only. "
            f"Remove {key}, or use the scheme {supporting('supports_edges')}."
        )
    if scene.run.plate_model == "infinite" and key == "plate.material":
        found.append(
            f"{words}: run.plate_model = 'infinite' is isotropic. Use run.plate_model = 'auto'."
        )
    if scene.run.plate_model == "infinite" and plate.modes is not None:
        found.append(
            f"{words}: run.plate_model = 'infinite' has no modes. Use run.plate_model = 'auto'."
        )
    return found


def _structure_problems(scene: _Uncontrolled) -> list[str]:
    """What the tables say of the plate that does not make one structure."""
    plate = scene.plate
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


def _plate_in_words(scene: _Uncontrolled) -> str:
    given = scene.plate.material
    name = given if isinstance(given, str) else given.name
    return f"plate.material = '{shortened(name)}'" if name else "the plate's material"


def _needs(capability: str, scheme: str, plate_model: str, key: str) -> list[str]:
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


def not_in_three_dimensions(
    striker: Striker,
    plate: PlateTable,
    contact: ContactTable,
    actuator: ActuatorTable,
    scheme: str,
    plate_model: str,
    orthotropic: bool,
    sensor_mass_kg: float | None,
) -> list[str]:
    """What does not fit a plate in three dimensions."""
    asked = "plate.theory = '3d'"
    found = _needs("supports_solid", scheme, plate_model, asked)
    only = f"{asked} supports a simply supported plate only"
    if plate.modes is not None:
        found.append(f"plate.modes of {plate.modes.file}: {only}. Use 'kirchhoff'.")
    elif plate.edges not in (None, "ssss"):
        found.append(f"plate.edges = '{plate.edges}': {only}. Remove the key, or use 'kirchhoff'.")
    elif orthotropic:
        found.append(
            f"plate.material: {asked} supports an isotropic plate only. Use another material, or "
            "'kirchhoff'."
        )
    if contact.damping != "none":
        found.append(
            f"contact.damping = '{contact.damping}': not supported by {asked}, because the "
            "velocity of a point on a solid diverges with the number of modes. Use "
            "contact.plasticity, or 'kirchhoff'."
        )
    for table, mass in (("actuator", actuator.mass_kg), ("sensors", sensor_mass_kg)):
        if mass is not None:
            found.append(
                f"{table}.mass_kg = {mass:g}: not supported by {asked}, because a point mass on a "
                "solid diverges with the number of modes. Remove the key, or use 'kirchhoff'."
            )
    stiffness = getattr(striker, "tip_stiffness", None)
    if stiffness is not None:
        found.append(
            f"hammer.tip_stiffness = {stiffness:g}: not supported by {asked}, which needs the "
            "radius of the contact. Give hammer.tip_radius_m, or use 'kirchhoff'."
        )
    if plate.tail == "damped":
        found.append(
            f"plate.tail = 'damped': not supported by {asked}, where the truncated modes form a "
            "half space. Use 'auto'."
        )
    return found


def _tail_problems(scene: _Uncontrolled) -> list[str]:
    """Where the modes left out are no damped mode."""
    if scene.plate.tail != "damped":
        return []
    asked, (contact, actuator) = "plate.tail = 'damped'", scene.plate.points_m
    for table, mass, point in (
        ("actuator", scene.actuator.mass_kg, actuator),
        ("sensors", scene.sensor_mass_kg, scene.sensor_point_m or contact),
    ):
        if mass is not None and point == contact:
            return [
                f"{asked}: not supported with {table}.mass_kg = {mass:g} at the contact point. Use "
                "'spring' or 'auto'."
            ]
    return _needs("supports_tail", scene.run.scheme, scene.run.plate_model, asked)


# Keys of the actuator that belong to the line, or act with a bandwidth only.
_BESIDE_DYNAMICS = ("damping", "dead_time_us", "stuck_from_s")


def _scheme_problems(scene: _Uncontrolled) -> list[str]:
    found = []
    contact, run = scene.contact, scene.run
    scheme = SCHEMES[run.scheme]

    def needs(capability: str, key: str) -> list[str]:
        return _needs(capability, run.scheme, run.plate_model, key)

    if contact.plasticity != "none":
        found += needs("supports_yield", f"contact.plasticity = '{contact.plasticity}'")
        plate = material_called(scene.plate.material, scene.materials or ())
        if contact.limiting_pressure_pa is None and plate.hardness_pa is plate.yield_pa is None:
            found.append(
                f"contact.plasticity = '{contact.plasticity}': the yield pressure of "
                f"{_plate_in_words(scene)} is unknown. Give plate.material.yield_pa, "
                "plate.material.hardness_pa or contact.limiting_pressure_pa, in Pa."
            )
    for key, field in type(scene.actuator).model_fields.items():  # a later key is refused, too
        value = getattr(scene.actuator, key)
        if key not in _BESIDE_DYNAMICS and value != field.default:
            found += needs("supports_actuator_dynamics", f"actuator.{key} = {value:g}")
    found += _tail_problems(scene) + _sensor_problems(scene)
    theory = STRUCTURES.get(scene.plate.theory)  # None for "auto"
    if theory is not None and theory.solid:
        striker = scene.sphere or scene.hammer
        assert striker is not None
        found += not_in_three_dimensions(
            striker, scene.plate, contact, scene.actuator, run.scheme, run.plate_model,
            material_called(scene.plate.material, scene.materials or ()).orthotropic,
            scene.sensor_mass_kg,
        )  # fmt: skip
    if scene.plate.radiating_faces:
        found += needs("supports_radiation", f"plate.radiation = '{scene.plate.radiation}'")
    point = scene.plate.actuator_point_m
    found += _beyond_simply_supported(scene)
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


# Keys of a table of which one stands in for the other.
_INSTEAD = {
    ("sphere", "speed_m_s"): "drop_height_m",
    ("sphere", "drop_height_m"): "speed_m_s",
    ("hammer", "tip_radius_m"): "tip_stiffness",
    ("hammer", "tip_stiffness"): "tip_radius_m",
}
_STRIKERS = ("sphere", "hammer")
_ANY = object()  # any value but None
# By table and key: the key of the same table that decides, and its value. The keys of laws are
# treated the same way, by the law that has them.
_READ_BY: dict[tuple[str, str], tuple[str, Any]] = {
    ("contact", "viscous_n_s_m"): ("damping", "viscous"),
    ("contact", "restitution"): ("damping", "hunt_crossley"),
    ("contact", "relaxation_stiffness"): ("damping", "relaxation"),
    ("contact", "relaxation_s"): ("damping", "relaxation"),
    ("contact", "relaxation_solve"): ("damping", "relaxation"),
    ("contact", "limiting_pressure_pa"): ("plasticity", "thornton"),
    ("actuator", "damping"): ("bandwidth_hz", _ANY),
}


def _reads(decided: Any, needed: Any) -> bool:
    return decided is not None if needed is _ANY else bool(decided == needed)


def unread(scene: Any) -> list[str]:
    """Sentences on keys of a scene's tables that are not at their default, but have no effect."""
    found = []
    for (name, key), (by, needed) in _READ_BY.items():
        table = getattr(scene, name)
        value, decided = getattr(table, key), getattr(table, by)
        if value == type(table).model_fields[key].default or _reads(decided, needed):
            continue
        has, give = f"with {name}.{by} = {shown(decided)}", f"{name}.{by} = {shown(needed)}"
        if needed is _ANY:
            has, give = f"without {name}.{by}", f"{name}.{by}"
        found.append(
            f"{name}.{key} = {shown(value)}: has no effect {has}. Leave the key out, or set {give}"
        )
    return found


def drop_unread(data: dict[str, Any], changed: Mapping[str, Any]) -> None:
    """Drop keys of a scene's tables that lose their effect because of the keys `changed`, or for
    which these stand in, unless they are among them."""
    for name, other in (_STRIKERS, _STRIKERS[::-1]):
        tables = {key.partition(".")[0] for key in changed}
        if name in tables and other not in tables:
            data.pop(other, None)
    for (name, key), other in _INSTEAD.items():
        if f"{name}.{key}" in changed and isinstance(data.get(name), dict):
            for lost in (other, "tip_exponent") if other == "tip_stiffness" else (other,):
                if f"{name}.{lost}" not in changed:
                    data[name].pop(lost, None)
    for (name, key), (by, needed) in _READ_BY.items():
        table, decides = data.get(name), f"{name}.{by}"
        if not isinstance(table, dict) or f"{name}.{key}" in changed:
            continue
        if decides in changed and not _reads(changed[decides], needed):
            table.pop(key, None)


DEFAULT = "aluminium-20mm"


def shipped() -> list[str]:
    """Names of the scenes that come with hertzloop, the default first."""
    folder = resources.files("hertzloop") / "scenes"
    names = [f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")]
    return sorted(names, key=lambda name: (name != DEFAULT, name))


def shipped_text(name: str) -> str:
    """The text of a shipped scene."""
    return (resources.files("hertzloop") / "scenes" / f"{name}.toml").read_text("utf-8")


def from_toml(text: str) -> dict[str, Any]:
    """TOML as plain data. Raises ValueError for whatever it cannot be, whatever the reason."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("its tables or lists are nested too deeply") from error


def toml_value(text: str) -> Any:
    """A value as written in TOML; a bare word counts as text."""
    try:
        return from_toml(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def toml_text(value: Any) -> str:
    """A value as written in TOML: what `toml_value` reads."""
    return tomli_w.dumps({"value": value}).removeprefix("value = ").strip()


_LONGEST = 80  # letters of a name
_NAME = re.compile(r"[^\W_][\w.-]*")


def possible_name(text: str) -> str:
    """Return a name that a scene may have, like the text."""
    plain = re.sub(r"[^\w.-]+", "-", unicodedata.normalize("NFC", text))
    return plain.strip("-_.")[:_LONGEST] or "mine"


class Scene(SceneTable):
    """A scene: one table per part, as in the TOML file. `load` and `vary` make it.

    `scene.controller.latency_us` reads a key. The page of scene keys lists all of them.
    """

    name: Annotated[str, Field(max_length=_LONGEST)]
    """of the scene, and of its recording: letters, digits, ".", "_" and "-"; first a letter or a
    digit"""
    shows: str = ""
    """what it is for, in a sentence"""
    materials: tuple[MaterialTable, ...] | None = None  # by name, beside those that come with it
    """a file of materials, or a list, beside those that come with it"""
    sphere: SphereTable | None = None
    hammer: HammerTable | None = None
    plate: PlateTable
    contact: ContactTable = ContactTable()
    sensors: SensorsTable = SensorsTable()
    controller: ControllerTable = ControllerTable()
    actuator: ActuatorTable = ActuatorTable()
    run: RunTable
    fit: FitTable | None = None
    """where fitted values come from"""

    @field_validator("name")
    @classmethod
    def _file_name(cls, value: str) -> str:
        name = unicodedata.normalize("NFC", value)
        if not _NAME.fullmatch(name):
            raise ValueError(
                f"name = {shown(value)}: must begin with a letter or a digit, and have letters, "
                f"digits, '.', '_' and '-' only. Use '{possible_name(value)}'."
            )
        return name

    @property
    def striker(self) -> Striker:
        """The table of what strikes the plate; a scene has one."""
        found = self.sphere or self.hammer
        assert found is not None
        return found

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return self.run.step_s

    @property
    def steps(self) -> int:
        """Length of the run in steps."""
        return self.run.steps

    def material(self, body: Literal["plate", "sphere"]) -> Material:
        """The material of the plate, or of the sphere or the hammer's tip."""
        given = self.plate.material if body == "plate" else self.striker.material
        return material_called(given, self.materials or ())

    def without_control(self) -> "Scene":
        """The same scene with the law switched off."""
        return self.replaced(controller=_switched_off(self.controller))

    @property
    def law(self) -> Law:
        """The law. Raises SceneError."""
        try:
            return self.controller.found
        except LawError as error:
            raise SceneError(str(error)) from error

    def whole_step_keys(self) -> list[str]:
        """Keys of the controller that have to be a whole number of steps."""
        return ["latency_us", "jitter_us", *self.law.whole_steps]

    @model_validator(mode="before")
    @classmethod
    def _name_the_quantity(cls, data: Any) -> Any:
        """Put what the law works on in the place of sensors.quantity = "auto"."""
        if not isinstance(data, dict):
            return data
        sensors, control = data.get("sensors", {}), data.get("controller", {})
        if not isinstance(sensors, dict) or not isinstance(control, dict):
            return data
        if sensors.get("quantity", "auto") != "auto":
            return data
        try:
            senses = find(
                str(control.get("law", "slope_threshold")), control.get("law_digest")
            ).senses
        except LawError:  # the table of the controller says so
            senses = "xi"
        senses = senses.partition(",")[0]  # the default of several
        if senses not in (*SENSED, "any"):  # see problems()
            senses = "xi"
        return {**data, "sensors": {**sensors, "quantity": senses.replace("any", "xi")}}

    @model_validator(mode="before")
    @classmethod
    def _materials_are_known(cls, data: Any) -> Any:
        if isinstance(data, dict):
            check_materials(data)
        return data

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> "Scene":
        for problem in [] if is_recorded(info) else problems(self):
            raise ValueError(problem)
        return self


_OF_LAWS = (".py", ".so", ".dylib", ".fmu")


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Scene:
    """Read a scene by shipped name or from a file, apply `key=value` settings and the seed.

    Files that it names are relative to its own folder, those that a setting names to the working
    directory. Raises SceneError with one sentence for anything wrong in it.
    """
    path = Path(source)
    if path.suffix in _OF_LAWS:
        raise SceneError(
            f"{shortened(source)}: is a law, not a scene. Use --set "
            f"{shortened(shlex.quote(f'controller.law={source}'))}."
        )
    if path.suffix == ".mcap":
        file = shortened(shlex.quote(source))
        raise SceneError(
            f"{shortened(source)}: is a recording, not a scene. To show it, run `hertzloop inspect "
            f"{file}`. To repeat it, run `hertzloop run --repeat {file}`."
        )
    text = _text(source)  # first: there may be no looking for it
    folder = path.parent if path.is_file() else None
    return parse(text, settings, seed, folder=folder, name=source)


def _text(source: str) -> str:
    path = Path(source)
    try:
        if path.suffix == ".toml" or path.is_file():
            return text_of(path.read_bytes())
    except (OSError, ValueError) as error:
        raise SceneError(
            f"cannot read the scene {shortened(source)}: {shortened(str(error))}"
        ) from error
    names = shipped()
    if source not in names:
        close = difflib.get_close_matches(source, names, 1)
        hint = f" Did you mean {close[0]}?" if close else ""
        raise SceneError(
            f"SCENE = {shown(source)}: unknown scene.{hint} Use one of {', '.join(names)}, "
            "or the path of a .toml file."
        )
    return shipped_text(source)


def parse(
    text: str,
    settings: Iterable[str] = (),
    seed: int | None = None,
    *,
    folder: Path | None = None,
    law: str | None = None,
    recorded: bool = False,
    name: str = "",
) -> Scene:
    """Make a scene from TOML text. Raises SceneError.

    The files that it names, its law's too, are looked for in `folder` and in the working folder;
    `law` says where the law is on this machine. A `recorded` scene need not find its law. `name`
    is what the text goes by. The law is read again, whatever was loaded before.
    """
    read_again()
    try:
        data = from_toml(text)
    except ValueError as error:
        raise SceneError(
            f"the scene{name and ' ' + shortened(name)} is not valid TOML: {shortened(str(error))}"
        ) from error
    _take_in(data, folder or Path())
    before = copy.deepcopy(data)
    _set(data, settings, folder)
    _take_in(data, Path())
    relabel(before, data)
    if seed is not None:
        _put(data, "run.seed", seed)
    if law is not None:
        _put(data, "controller.law", law)
    return _checked(data, folder, recorded)


def on_modes(source: str, settings: Iterable[str], modes: str, name: str) -> dict[str, Any]:
    """Tables of a scene with a file of modes in the place of its plate.

    Args:
        source: a shipped scene, or a file. Of its plate, the material stays.
        settings: `key=value`, set after that.
        modes: name of the file of modes, beside the new scene.
        name: name of the new scene.

    Raises:
        SceneError: there is no such scene, or a setting is wrong.
    """
    path = Path(source)
    folder = path.parent if path.is_file() else Path()
    data = from_toml(_text(source))
    plate = data.get("plate")
    material = plate.get("material") if isinstance(plate, dict) else None
    data["plate"] = {"material": material} if material else {}
    _take_in(data, folder)
    _set(data, settings, folder)
    data["plate"]["modes"], data["name"] = modes, name
    return {key: data[key] for key in ("name", *data)}


def vary(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Return a scene with other values.

    Args:
        scene: the scene, which stays as it is.
        values: new values by scene key, for example {"sphere.radius_m": 0.004}.

    Raises:
        SceneError: a key is unknown, or a value is not possible.
    """
    found = _by_tables(scene, values)
    if found is not None:
        return found
    law = values.get("controller.law")
    if len(values) > 1 and law in shipped_laws():
        # The cases of a sweep name the same few laws again and again.
        with_law = _with_law(scene, law)
        others = {key: value for key, value in values.items() if key != "controller.law"}
        found = None if with_law is None else _by_tables(with_law, others)
        if found is not None:
            return found
    data = _opened(scene, {key.split(".")[0] for key in values})
    drop_unread(data, values)
    if "controller.law" in values:
        try:
            name = resolve(str(values["controller.law"]))
            switch_law(data["controller"], name)
        except LawError as error:
            raise SceneError(str(error)) from error
        if "sensors.quantity" not in values:
            data["sensors"]["quantity"] = "auto"
    for key, value in values.items():
        _put(data, key, value)
    _take_in(data, Path())
    found = _checked(data)
    if f"controller.{_DIGEST}" not in values:
        _found_as_in(scene.controller, found.controller)
    return found


def _by_tables(scene: Scene, values: Mapping[str, Any]) -> Scene | None:
    """The scene with tables that were checked before; None where that does not do."""
    tables = changed_tables(scene, values)
    if tables is None:
        return None
    found = scene.replaced(**tables)
    return None if problems(found) else found


@lru_cache(maxsize=64)
def _with_law(scene: Scene, law: str) -> Scene | None:
    """The scene under another shipped law; None if that does not fit it."""
    try:
        return vary(scene, {"controller.law": law})
    except SceneError:
        return None


_READ_TOGETHER = {"sensors", "controller"}  # the one may have to name what the other works on


def _opened(scene: Scene, changed: set[str]) -> dict[str, Any]:
    """A scene's tables: those `changed` as plain data, the others as they are, which were checked
    once. Own materials are plain data too: a changed table may go back to their numbers."""
    if changed & _READ_TOGETHER:
        changed = changed | _READ_TOGETHER
    if "materials" in changed:  # by name in other tables
        changed = set(Scene.model_fields)
    data = {name: value for name, value in scene if name not in changed and value is not None}
    return data | scene.model_dump(include=changed | {"materials"}, exclude_none=True)


_DIGEST = "law_digest"


def _found_as_in(table: SceneTable, changed: SceneTable) -> None:
    """Note in a changed table that its law's digest was found, not asked for, if so in `table`."""
    if _DIGEST not in table.model_fields_set:
        changed.model_fields_set.discard(_DIGEST)


def with_law_as_it_is(scene: Scene) -> Scene:
    """The scene with its law as that is now, read again. Raises SceneError for a law that changed,
    if the scene asks for one digest."""
    if scene.controller.law in shipped_laws():
        return scene
    read_again()
    data = _opened(scene, {"controller"})
    if _DIGEST not in scene.controller.model_fields_set:
        del data["controller"][_DIGEST]
    now = _checked(data)
    return scene if now.controller.law_digest == scene.controller.law_digest else now


# What a scene says by the name of a file: materials and modes, taken into the scene itself.
#
# After that the scene needs no file any more: every process, the recording and whoever runs it
# again have the very numbers.

_MOST_PACKED = 8 << 20  # in a scene, and so in one message on the bus


def _take_in(data: dict[str, Any], folder: Path) -> None:
    """Put files named in a scene's tables in their place; names are relative to `folder`. Raises
    SceneError.

    The table `uncertain` is for `--uncertain` alone: a run has one value for each key.
    """
    try:
        data.pop("uncertain", None)
        if isinstance(data.get("materials"), str):
            data["materials"] = _materials(folder / data["materials"])
        plate = data.get("plate")
        if isinstance(plate, dict) and isinstance(plate.get("modes"), str):
            plate["modes"] = _modes(folder / plate["modes"])
        control = data.get("controller")
        if isinstance(control, dict):
            trace = control.get("latency_trace")
            if isinstance(trace, str):
                control["latency_trace"] = _latencies(folder / trace)
            elif isinstance(trace, dict):
                control["latency_trace"] = _drawn_latencies(trace)
            if control.get("law") in shipped_laws():
                read_files = getattr(find(control["law"]).home, "read_files", None)
                if read_files is not None:
                    read_files(control, folder)
    except ValueError as error:
        raise SceneError(shortened(str(error), LONGEST)) from error


# Numbers that a distribution of latencies must have, with their least value.
_DRAWN = {"median_us": 0.0, "sigma": 0.0, "autocorrelation": 0.0}
_SAMPLES = 4096
_TRACE = 13  # random stream of these latencies


def _drawn_latencies(table: dict[str, Any]) -> list[float]:
    """Latencies that are log-normal, with an autocorrelation from one sample to the next.

    The logarithms form a first-order autoregressive process. `least_us` is added, `seed` and
    `samples` are 1 and 4096 if left out.
    """
    said = "controller.latency_trace"
    known = {*_DRAWN, "least_us", "seed", "samples"}
    if unknown := sorted(set(table) - known):
        raise ValueError(f"{said}.{unknown[0]}: unknown key. Use {', '.join(sorted(known))}")
    numbers: dict[str, Any] = {"least_us": 0.0, "seed": 1, "samples": _SAMPLES} | table
    for name, least in {**_DRAWN, "least_us": 0.0, "seed": 0, "samples": 1}.items():
        value = numbers.get(name)
        whole = name in ("seed", "samples")
        good = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        most = {"autocorrelation": 1.0 - 1e-9, "samples": _MOST_LATENCIES}.get(name, 1e6)
        if not good or not least <= cast(float, value) <= most:
            raise ValueError(
                f"{said}.{name} = {shown(value)}: must be a {'whole ' if whole else ''}number from "
                f"{least:g} to {most:g}"
            )
    normal = np.random.Generator(np.random.Philox(key=[numbers["seed"], _TRACE])).standard_normal(
        numbers["samples"]
    )
    keep, walk = numbers["autocorrelation"], float(normal[0])
    found = [walk]
    for one in normal[1:]:
        walk = keep * walk + math.sqrt(1.0 - keep * keep) * float(one)
        found.append(walk)
    logs = numbers["sigma"] * np.array(found)
    return [round(float(x), 3) for x in numbers["least_us"] + numbers["median_us"] * np.exp(logs)]


_LATENCY = "latency"  # name of the column of a trace that has several
_MOST_LATENCIES = 1_000_000


def _latencies(path: Path) -> list[float]:
    """Latencies of a text table, us: its only column, or the one called latency, in the unit of its
    heading, or else in us. Of a recording (.mcap) of a paced run, those that it had."""
    said = f"controller.latency_trace = {_echoed(path)}"
    if path.suffix == ".mcap":
        # 0.03 s of every start, for traces of this kind alone.
        from hertzloop.recordings.latencies import latencies_of
        from hertzloop.recordings.reader import read

        try:
            return [float(x) for x in latencies_of(read(path))]
        except (ValueError, OSError, RuntimeError) as error:
            raise ValueError(f"{said}: {shortened(str(error))}") from error
    try:
        table = read_table(path, (_LATENCY,))
    except (OSError, TableError) as error:
        raise ValueError(f"{said}: cannot be read: {shortened(str(error))}") from error
    split = [(name_and_unit(column.heading, (_LATENCY,)), column) for column in table.columns]
    if len(split) > 1:
        split = [one for one in split if plain_name(one[0][0]) == _LATENCY]
    if table.columns and len(split) != 1:
        raise ValueError(f"{said}: has several columns. Call one of them latency_us")
    found: list[float] = []
    for (_, stated), column in split:
        unit = unit_of(stated or column.unit or "us")
        if unit is None or unit.si != "s":
            raise ValueError(
                f"{said}: '{stated or column.unit}' is no unit of time. Use latency_us"
            )
        found = [round(1e6 * unit.size * float(value), 9) for value in column.values]
        gaps = [i for i, value in enumerate(found) if not math.isfinite(value)]
        if gaps or table.notes:
            where = f"row {gaps[0] + 1} of the numbers has no number" if gaps else table.notes[0]
            raise ValueError(f"{said}: {where.rstrip('.')}. Give a latency in every line")
    if not 1 <= len(found) <= _MOST_LATENCIES:
        raise ValueError(f"{said}: has {len(found)} latencies. Give 1 to {_MOST_LATENCIES}")
    return found


def open_material(data: dict[str, Any], body: str, key: str = "material") -> None:
    """Put a material's numbers in the place of its name, so that one of them can be changed."""
    table = data.get(body)
    name = table.get(key) if isinstance(table, dict) else None
    if not isinstance(table, dict) or not isinstance(name, str):
        return
    materials = data.get("materials")
    for own in materials if isinstance(materials, list | tuple) else ():
        if isinstance(own, dict) and own.get("name") == name:
            table[key] = dict(own)
            return
    if name in SHIPPED:
        table[key] = {"name": name, **SHIPPED[name]}


def _echoed(path: Path) -> str:
    return shortened(repr(str(path)))


def _materials(path: Path) -> list[dict[str, object]]:
    try:
        text = text_of(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ValueError(
            f"materials = {_echoed(path)}: cannot be read: {shortened(str(error))}"
        ) from error
    return [{"name": name, **table} for name, table in materials_of(text, str(path)).items()]


def _modes(path: Path) -> dict[str, str]:
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"plate.modes = {_echoed(path)}: unknown format. Use a file that ends in "
            f"{', '.join(SUFFIXES)}."
        )
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ValueError(f"plate.modes = {_echoed(path)}: cannot be read: {why}") from error
    read_modes(path.name, content)
    packed = base64.b64encode(zlib.compress(content, 9)).decode("ascii")
    if len(packed) > _MOST_PACKED:
        raise ValueError(
            f"plate.modes = {_echoed(path)}: needs {len(packed) / 1e6:.3g} MB in a recording; the "
            f"limit is {_MOST_PACKED / 1e6:.3g}. Use fewer modes or a coarser grid."
        )
    return {
        "file": path.name,
        "sha256": hashlib.sha256(content).hexdigest(),
        "content": packed,
    }


_MOST_LETTERS = 80  # letters of a name that are compared


def check_materials(data: Mapping[str, Any]) -> None:
    """Raise ValueError with one sentence for what is no material in a scene's tables."""
    known = dict.fromkeys(MATERIALS)
    given = data.get("materials")
    for own in given if isinstance(given, list | tuple) else ():
        if isinstance(own, dict):
            name = str(own.get("name", ""))
            if not name:
                raise ValueError("materials: an entry has no name. Add its name.")
            material_of(f"materials: {name}", numbers_of_material(own))
            known[name] = None
    for body, key in (("plate", "material"), ("sphere", "material"), ("hammer", "tip_material")):
        table = data.get(body)
        given = table.get(key) if isinstance(table, dict) else None
        if isinstance(given, dict):
            material_of(f"{body}.{key}", numbers_of_material(given))
        elif isinstance(given, str) and given not in known:
            close = difflib.get_close_matches(given[:_MOST_LETTERS], known, 1)
            hint = f"Did you mean {close[0]}? " if close else ""
            raise ValueError(
                f"{body}.{key} = {shown(given)}: unknown material. {hint}Use one of "
                f"{', '.join(known)}, or give young_pa, density_kg_m3 and poisson."
            )


def _checked(data: dict[str, Any], folder: Path | None = None, recorded: bool = False) -> Scene:
    control = data.get("controller")
    try:
        law = control.get("law") if isinstance(control, dict) else None
        if isinstance(control, dict) and isinstance(law, str) and law not in shipped_laws():
            data = {**data, "controller": {**control, "law": resolve(law, folder)}}
        return Scene.model_validate(data, context={"recorded": recorded})
    except LawError as error:
        raise SceneError(str(error)) from error
    except ValidationError as error:
        raise SceneError(sentence(error, Scene)) from error


def _set(data: dict[str, Any], texts: Iterable[str], folder: Path | None) -> None:
    """Set each `key=value`, and drop keys of a file that have no effect any more. Raises
    SceneError."""
    pairs = [setting_of(text) for text in texts]
    settings = dict(pairs)
    drop_unread(data, settings)
    law, table = settings.get("controller.law"), data.get("controller")
    if isinstance(law, str) and isinstance(table, dict):
        with suppress(LawError):  # the check of the table says so
            if isinstance(table.get("law"), str):
                table["law"] = resolve(table["law"], folder)
            switch_law(table, resolve(law), written=True)
    for key, value in pairs:
        _put(data, key, value)


def setting_of(setting: str) -> tuple[str, Any]:
    """Key and value of one key=value; the value is TOML, a bare word counts as text. Raises
    SceneError."""
    key, equals, value = setting.partition("=")
    if not equals or not all(key.strip().split(".")):
        raise SceneError(
            f"--set {shown(setting)}: invalid setting. Write table.key=value, as in "
            "sensors.bits=12."
        )
    return key.strip(), toml_value(value)


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    """Set table.key in nested tables."""
    path = key.split(".")
    table = data
    if path[1:2] in (["material"], ["tip_material"]) and len(path) == 3:
        open_material(data, path[0], path[1])
    for part in path[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise SceneError(
                f"{shown(key)}: unknown scene key; {shown(part)} is a value, not a table."
            )
    table[path[-1]] = value


def grain_of(scene: Scene, key: str) -> float:
    """How far apart the values of "table.key" are: 1 of whole numbers, a step of the controller's
    times (us), 0 of any numbers and of what is no key."""
    *path, last = key.split(".")
    if path == ["controller"]:
        info = law_key(scene.controller, last)
        kind: Any = info.annotation if info else None
        if last in scene.whole_step_keys() or (info and WHOLE_STEPS in info.metadata):
            return scene.run.step_ns / 1000
    else:
        try:
            kind = table_at(tuple(path), Scene).model_fields[last].annotation
        except (KeyError, AttributeError):
            return 0.0
    kinds = {kind, *get_args(kind)}
    kinds |= {inner for outer in kinds for inner in get_args(outer)}
    return 1.0 if int in kinds else 0.0


_KEPT = 4096  # tables: the cases of a sweep give each the same few values again and again
# What other tables, or files, have a say in.
_NOT_ALONE = {
    "plate.modes", "sensors.quantity", "controller.law", "controller.law_digest",
    "controller.latency_trace", "controller.filter_file",
}  # fmt: skip


def changed_tables(scene: BaseModel, values: Mapping[str, Any]) -> dict[str, SceneTable] | None:
    """The tables that hold the keys "table.key" of `values`, with these; None where that takes
    more than these tables, or one of them does not allow it."""
    by_table: dict[str, dict[str, Any]] = defaultdict(dict)
    for key, value in values.items():
        name, dot, last = key.partition(".")
        if key in _NOT_ALONE or not dot or "." in last:
            return None
        if last == "material" and not (isinstance(value, str) and value in MATERIALS):
            return None  # one of the scene's own, or unknown
        by_table[name][last] = value
    found = {}
    for name, changes in by_table.items():
        table = getattr(scene, name, None)
        if not isinstance(table, SceneTable):
            return None
        try:
            changed = _changed(table, tuple(changes), *changes.values())
        except TypeError:  # a list cannot be looked up
            return None
        if changed is None:
            return None
        found[name] = changed
    return found


@lru_cache(maxsize=_KEPT, typed=True)  # True is no 1
def _changed(table: SceneTable, names: tuple[str, ...], *values: Any) -> SceneTable | None:
    given = vars(table) | (table.__pydantic_extra__ or {})
    try:
        changed = type(table).model_validate(given | dict(zip(names, values, strict=True)))
    except ValidationError:
        return None
    _found_as_in(table, changed)
    return changed


def relabel(before: dict[str, Any], after: dict[str, Any]) -> None:
    """Give the scene `after` its settings a name that fits, unless they name it themselves.

    "aluminium-3mm" with plate.material = "titanium" is "titanium-3mm"; what it is said to show
    is left out, as it was written for another.
    """
    if not isinstance(before.get("name"), str) or after.get("name") != before["name"]:
        return
    name = before["name"]
    for old, new in (
        (_material(before, "plate"), _material(after, "plate")),
        (_radius(before), _radius(after)),
        (_material(before, "sphere"), _material(after, "sphere")),
        (_value(before, "plate", "edges"), _value(after, "plate", "edges")),
        (_file(before), _file(after)),
    ):
        if new and new != old:
            name = _with(name, old, new)
    thickness = (_value(scene, "plate", "thickness_m") for scene in (before, after))
    if name == before["name"] and next(thickness) == next(thickness):
        return
    after["name"] = possible_name(name)
    after.pop("shows", None)


def _with(name: str, old: str, new: str) -> str:
    """The name with a word exchanged, or one more."""
    words = name.split("-")
    if old in words:
        return "-".join(new if word == old else word for word in words)
    return f"{name}-{new}"


def _value(scene: dict[str, Any], table: str, key: str) -> Any:
    found = scene.get(table)
    return found.get(key) if isinstance(found, dict) else None


def _material(scene: dict[str, Any], body: str) -> str:
    """A material's name; numbers that are none of a name's count as another material."""
    found = _value(scene, body, "material")
    if isinstance(found, dict):
        return f"own-{found.get('name') or 'material'}"
    return str(found or "")


def _radius(scene: dict[str, Any]) -> str:
    if isinstance(scene.get("hammer"), dict):
        return "hammer"
    found = _value(scene, "sphere", "radius_m")
    if not isinstance(found, int | float) or isinstance(found, bool):
        return ""
    try:
        return f"{1e3 * found:g}mm"
    except OverflowError:  # a whole number beyond all radii, which is refused later
        return ""


def _file(scene: dict[str, Any]) -> str:
    found = _value(scene, "plate", "modes")
    return str(found.get("file", "")).rpartition(".")[0] if isinstance(found, dict) else ""
