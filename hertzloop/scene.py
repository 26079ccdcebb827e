"""Scenes: what is simulated, as one TOML file, checked before anything runs."""

import difflib
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

_MAX_STEPS = 20_000_000
_MAX_THESIS_STEPS = 500_000


NO_CASE_OF_THESIS = (
    "run.scheme = 'thesis2008' has figures of its own; take 'modal' or 'discrete_gradient'"
)


class SceneError(ValueError):
    """The scene cannot be simulated; the message says which key, its value and what would do."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, allow_inf_nan=False)


Point = tuple[float, float]
MaterialName = Literal["steel", "aluminium", "oak", "sylomer_m"]
PrecomputedName = Literal[
    "F_a1", "F_a2", "F_a3", "F_a4", "F_a5", "F_a6", "F_a7", "F_a8", "F_a9", "F_a10", "F_a11",
    "F_a12", "F_a13", "F_mobility",
]  # fmt: skip


LawName = Literal[
    "off", "slope_threshold", "least_squares", "shifted_threshold", "predicted", "fade_out",
    "force_feedback", "velocity_feedback", "acceleration_feedback",
    "constant", "profile", "precomputed",
]  # fmt: skip
# What the feedback laws work on; the others, on the penetration.
SENSED = {
    "force_feedback": "contact_force",
    "velocity_feedback": "v_p",
    "acceleration_feedback": "acceleration",
}


class SphereTable(_Table):
    """The falling sphere."""

    material: MaterialName = "steel"
    radius_m: Annotated[float, Field(ge=1e-5, le=1.0)]
    drop_height_m: Annotated[float, Field(ge=1e-7, le=100.0)]


class PlateTable(_Table):
    """The plate, the struck point and where the actuator pushes (default: the struck point)."""

    material: MaterialName
    size_m: tuple[
        Annotated[float, Field(ge=0.01, le=20.0)], Annotated[float, Field(ge=0.01, le=20.0)]
    ]
    thickness_m: Annotated[float, Field(ge=1e-5, le=1.0)]
    contact_point_m: Point
    actuator_point_m: Point | None = None
    loss_factor: Annotated[float, Field(ge=0.0, le=1.0)] | None = None


class ContactTable(_Table):
    """Damping inside the contact; `relaxation_*` are s_tau (N/m^1.5), tau (s) and the solve."""

    damping: Literal["none", "viscous", "hunt_crossley", "relaxation"] = "none"
    viscous_n_s_m: Annotated[float, Field(ge=0.0, le=1e9)] = 0.0
    restitution: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    relaxation_stiffness: Annotated[float, Field(ge=0.0, le=1e18)] = 0.0
    relaxation_s: Annotated[float, Field(gt=0.0, le=1e3)] = 1e-3
    relaxation_solve: Literal["published", "bracketed"] = "bracketed"


class SensorsTable(_Table):
    """Data acquisition. `quantity` "auto", or left out, becomes what the law works on;
    `full_scale` is lowest and highest value, "auto" or "none"."""

    quantity: Literal["xi", "v_p", "acceleration", "contact_force", "auto"] = "auto"
    every_steps: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    bits: Annotated[int, Field(ge=1, le=24)] | Literal["ideal"] = "ideal"
    full_scale: Point | Literal["auto", "none"] = "auto"
    low_pass_hz: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    noise_rms: Annotated[float, Field(ge=0.0)] = 0.0


class ControllerTable(_Table):
    """Force law and the line to the actuator. `precomputed` names one of the study's forces;
    with `lead_us` slope_threshold commands what is due that much later. `window_samples`: for the
    slope of least_squares and predicted; `fade_us`: length of fade_out after the contact;
    `leak_hz`: corner of the integral of acceleration_feedback."""

    law: LawName = "slope_threshold"
    kappa: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.8
    v_thr_m_s: Annotated[float, Field(ge=-1e3, le=1e3)] = -0.25
    force_n: float = 0.0
    profile_n: tuple[float, ...] = ()
    precomputed: PrecomputedName = "F_a2"
    lead_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    window_samples: Annotated[int, Field(ge=2, le=1000)] = 4
    fade_us: Annotated[float, Field(ge=0.0, le=1e6)] = 10.0
    leak_hz: Annotated[float, Field(ge=0.0, le=1e6)] = 20.0
    delay_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    duration_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    latency_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    jitter_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    drop_out_probability: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    bits: Annotated[int, Field(ge=2, le=24)] | Literal["ideal"] = "ideal"
    full_scale_n: Annotated[float, Field(gt=0.0)] | None = None
    slew_n_s: Annotated[float, Field(gt=0.0)] | None = None


class RunTable(_Table):
    """Length, scheme, step, accuracy and seed. The run starts `lead_in_s` before the first
    contact. `plate_model`: the plate's modes, an infinite plate, or ("auto") the infinite one
    where the run is over before reflections matter at `accuracy`."""

    duration_s: Annotated[float, Field(gt=0.0)]
    scheme: Literal["modal", "discrete_gradient", "thesis2008"] = "modal"
    plate_model: Literal["auto", "modal", "infinite"] = "auto"
    lead_in_s: Annotated[float, Field(ge=0.0)] = 1e-3
    step_ns: Annotated[int, Field(ge=1, le=1_000_000)] = 1000
    accuracy: Annotated[float, Field(ge=1e-9, le=0.5)] = 1e-3
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1


class Scene(_Table):
    """A whole scene; see scenes/*.toml for examples."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80)]
    shows: str = ""
    sphere: SphereTable
    plate: PlateTable
    contact: ContactTable = ContactTable()
    sensors: SensorsTable = SensorsTable()
    controller: ControllerTable = ControllerTable()
    run: RunTable

    @property
    def step_s(self) -> float:
        """Length of a step, s."""
        return self.run.step_ns * 1e-9

    @property
    def steps(self) -> int:
        """Length of the run in steps."""
        return round(self.run.duration_s / self.step_s)

    def in_steps(self, time_us: float) -> int:
        """A time in whole steps."""
        return round(time_us * 1000 / self.run.step_ns)

    def without_control(self) -> "Scene":
        """The same scene with the law switched off."""
        return self.model_copy(
            update={"controller": self.controller.model_copy(update={"law": "off"})}
        )

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
        quantity = SENSED.get(str(control.get("law", "slope_threshold")), "xi")
        return {**data, "sensors": {**sensors, "quantity": quantity}}

    @model_validator(mode="after")
    def _fits_together(self) -> "Scene":
        for problem in _problems(self):
            raise ValueError(problem)
        return self


def _problems(scene: Scene) -> "list[str]":
    """Sentences on values that are fine alone, but not together."""
    found = []
    plate, run, control = scene.plate, scene.run, scene.controller
    for key in ("contact_point_m", "actuator_point_m"):
        point = getattr(plate, key)
        if point and not all(0 < p < size for p, size in zip(point, plate.size_m, strict=True)):
            found.append(
                f"plate.{key} = {list(point)} lies outside the plate; both numbers must be above 0 "
                f"and below plate.size_m = {list(plate.size_m)}"
            )
    if not 1 <= scene.steps <= _MAX_STEPS:
        found.append(
            f"run.duration_s = {run.duration_s:g} makes {scene.steps} steps of run.step_ns = "
            f"{run.step_ns}; a run has 1 to {_MAX_STEPS} steps"
        )
    for key in ("latency_us", "jitter_us", "lead_us", "fade_us", "delay_us", "duration_us"):
        if key == "fade_us" and control.law != "fade_out":
            continue  # its default need not fit every step
        value = getattr(control, key)
        if abs(value * 1000 / run.step_ns - scene.in_steps(value)) > 1e-9 * max(1.0, value):
            found.append(
                f"controller.{key} = {value:g} is no whole number of steps; take a multiple of "
                f"{run.step_ns / 1000:g} us (run.step_ns = {run.step_ns})"
            )
    wanted = SENSED.get(control.law, "xi")
    if control.law != "off" and scene.sensors.quantity != wanted:
        found.append(
            f"sensors.quantity = '{scene.sensors.quantity}' does not fit controller.law = "
            f"'{control.law}', which works on '{wanted}'; take that or 'auto', or law 'off'"
        )
    found += _scheme_problems(scene)
    if control.law == "profile" and not control.profile_n:
        found.append("controller.profile_n is empty; law 'profile' needs one force (N) a sample")
    if control.law == "constant" and control.duration_us == 0:
        found.append("controller.duration_us = 0; law 'constant' needs the length of its force")
    if control.bits != "ideal" and control.full_scale_n is None:
        found.append(
            f"controller.bits = {control.bits} needs controller.full_scale_n, the largest force (N)"
        )
    limits = scene.sensors.full_scale
    if isinstance(limits, tuple) and not limits[0] < limits[1]:
        found.append(
            f"sensors.full_scale = {list(limits)} is no range; the first number must be the lower"
        )
    if scene.sensors.bits != "ideal" and limits == "none":
        found.append(
            f"sensors.bits = {scene.sensors.bits} needs a range in sensors.full_scale, not 'none'"
        )
    return found


def _scheme_problems(scene: Scene) -> "list[str]":
    """What the chosen scheme and model of the plate do not know."""
    found = []
    point = scene.plate.actuator_point_m
    if scene.run.plate_model == "infinite":
        if scene.run.scheme != "modal":
            found.append(
                "run.plate_model = 'infinite' is known to run.scheme = 'modal' only, not to "
                f"'{scene.run.scheme}'; take that scheme, or plate_model 'auto'"
            )
        if point is not None and point != scene.plate.contact_point_m:
            found.append(
                f"plate.actuator_point_m = {list(point)} does not fit run.plate_model = "
                "'infinite', which knows a force at the struck point only; leave the key out, or "
                "take plate_model 'auto'"
            )
    if scene.run.scheme != "thesis2008":
        if scene.contact.damping == "relaxation":
            found.append(
                "contact.damping = 'relaxation' is known to run.scheme = 'thesis2008' only; take "
                "'none', 'viscous' or 'hunt_crossley', or that scheme"
            )
        return found
    if scene.contact.damping == "hunt_crossley":
        found.append(
            "contact.damping = 'hunt_crossley' is not known to run.scheme = 'thesis2008'; take "
            "'none', 'viscous' or 'relaxation', or the scheme 'modal'"
        )
    if point is not None and point != scene.plate.contact_point_m:
        found.append(
            f"plate.actuator_point_m = {list(point)} does not fit run.scheme = 'thesis2008', which "
            "knows a force at the struck point only; leave the key out, or take the scheme 'modal'"
        )
    if scene.steps > _MAX_THESIS_STEPS:
        found.append(
            f"run.duration_s = {scene.run.duration_s:g} makes {scene.steps} steps; run.scheme = "
            f"'thesis2008' takes up to {_MAX_THESIS_STEPS}, as the work grows with their square"
        )
    return found


def shipped() -> list[str]:
    """Names of the scenes that come with hertzloop, the default first."""
    folder = resources.files("hertzloop") / "scenes"
    names = [f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")]
    return sorted(names, key=lambda name: (name != DEFAULT, name))


DEFAULT = "aluminium-3mm"


def load(source: str, settings: Iterable[str] = (), seed: int | None = None) -> Scene:
    """Read a scene by shipped name or from a file, apply `key=value` settings and the seed.

    Raises SceneError with one sentence for anything wrong in it.
    """
    return parse(_text(source), settings, seed)


def _text(source: str) -> str:
    path = Path(source)
    if path.suffix == ".toml" or path.is_file():
        try:
            return path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SceneError(f"cannot read the scene {source}: {error}") from error
    names = shipped()
    if source not in names:
        close = difflib.get_close_matches(source, names, 1)
        hint = f"; did you mean {close[0]}?" if close else "."
        raise SceneError(
            f"there is no scene '{source}'{hint} Known scenes: {', '.join(names)}; "
            "or give the path of a .toml file"
        )
    return (resources.files("hertzloop") / "scenes" / f"{source}.toml").read_text("utf-8")


def parse(text: str, settings: Iterable[str] = (), seed: int | None = None) -> Scene:
    """Make a scene from TOML text. Raises SceneError."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"the scene is not valid TOML: {error}") from error
    for setting in settings:
        _apply(data, setting)
    if seed is not None:
        data.setdefault("run", {})["seed"] = seed
    return _checked(data)


def vary(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """A scene with other values of some keys, "table.key": value. Raises SceneError."""
    data = scene.model_dump(exclude_none=True)
    if "controller.law" in values and "sensors.quantity" not in values:
        data["sensors"]["quantity"] = "auto"
    for key, value in values.items():
        _put(data, key, value)
    return _checked(data)


def _checked(data: dict[str, Any]) -> Scene:
    try:
        return Scene.model_validate(data)
    except ValidationError as error:
        raise SceneError(_sentence(error)) from error


def _apply(data: dict[str, Any], setting: str) -> None:
    """Apply one key=value; the value is TOML, a bare word counts as text."""
    key, equals, value = setting.partition("=")
    if not equals or not all(key.strip().split(".")):
        raise SceneError(f"'{setting}' is no setting; write table.key=value, e.g. sensors.bits=12")
    _put(data, key.strip(), toml_value(value))


def toml_value(text: str) -> Any:
    """A value as written in TOML; a bare word counts as text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    """Set table.key in nested tables."""
    path = key.split(".")
    table = data
    for part in path[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise SceneError(f"'{key}' is no scene key: '{part}' is a value, not a table")
    table[path[-1]] = value


def _known_keys(path: tuple[str, ...]) -> list[str]:
    """Keys of the table at `path` of a scene."""
    model: Any = Scene
    for part in path:
        model = model.model_fields[part].annotation
    return list(model.model_fields)


def grain_of(scene: Scene, key: str) -> float:
    """How far apart the values of "table.key" are: 1 of whole numbers, a step of the controller's
    times (us), 0 of any numbers and of what is no key."""
    *path, last = key.split(".")
    try:
        model: Any = Scene
        for part in path:
            model = model.model_fields[part].annotation
        kind = model.model_fields[last].annotation
    except (KeyError, AttributeError):
        return 0.0
    if path == ["controller"] and last.endswith("_us"):
        return scene.run.step_ns / 1000
    kinds = {kind, *get_args(kind)}
    kinds |= {inner for outer in kinds for inner in get_args(outer)}
    return 1.0 if int in kinds else 0.0


def _sentence(error: ValidationError) -> str:
    """The first problem as one sentence."""
    problem = error.errors()[0]
    path = tuple(str(p) for p in problem["loc"])
    if problem["type"] == "extra_forbidden":
        known = _known_keys(path[:-1])
        close = difflib.get_close_matches(path[-1], known, 1)
        hint = f"did you mean {close[0]}? " if close else ""
        return f"{'.'.join(path)} is no scene key; {hint}Known here: {', '.join(known)}"
    if problem["type"] == "missing":
        return f"{'.'.join(path)} is missing from the scene"
    if problem["type"] == "value_error":
        return str(problem["ctx"]["error"])
    keys = tuple(p for p in path if p in _field_path(path))
    same = [
        p["msg"] for p in error.errors() if tuple(str(q) for q in p["loc"])[: len(keys)] == keys
    ]
    wanted = " or ".join(dict.fromkeys(m[0].lower() + m[1:] for m in same))
    return f"{'.'.join(keys)} = {problem['input']!r} will not do: {wanted}"


def _field_path(path: tuple[str, ...]) -> tuple[str, ...]:
    """The part of an error's location that names scene keys, without union branches."""
    for length in range(len(path), 0, -1):
        try:
            known = _known_keys(path[: length - 1])
        except (KeyError, AttributeError):
            continue
        if path[length - 1] in known:
            return path[:length]
    return path


def to_toml(scene: Scene) -> str:
    """The scene as TOML, every key written out: what goes into the recording."""
    return tomli_w.dumps(scene.model_dump(exclude_none=True))
