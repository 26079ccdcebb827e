"""Laws as co-simulation units (FMU), as Simulink and Modelica tools export them; FMPy runs them.

The unit's one input gets the sample, its one output is the command, its real parameters are
scene keys. A communication step is a sample.
"""

import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import BaseModel, create_model

from hertzloop.controller.law import ACTING, WATCHING, Keys, LawContext, LawError
from hertzloop.controller.loading.bound import BoundLaw
from hertzloop.controller.loading.callbacks import addresses_of, python_functions
from hertzloop.controller.loading.law import Law, key_field
from hertzloop.controller.loading.records import PackedRecord, pack, state_of

_REAL = ("Real", "Float64")
# Names of an input that say what is sensed; a quantity of one's own is asked for in the scene.
_QUANTITIES = ("xi", "v_p", "acceleration", "contact_force")
_INPUTS, _OUTPUT = (*_QUANTITIES, "sample"), "force"  # where a unit has more than one
# Exponents of kg, m, s of an input's unit, with the quantity; those of a force.
_FORCE, _NUMBER = (1, 1, -2), (0, 0, 0)
_DIMENSIONS = {
    (0, 1, 0): "xi",
    (0, 1, -1): "v_p",
    (0, 1, -2): "acceleration",
    _FORCE: "contact_force",
}
_SI = {
    "m": (0, 1, 0),
    "m/s": (0, 1, -1),
    "m/s2": (0, 1, -2),
    "m/s^2": (0, 1, -2),
    "N": _FORCE,
}
_SAME_STEP = 1e-6  # relative difference of equal times


@dataclass(frozen=True)
class _Port:
    """A real variable of a unit, and its value in SI units per value of its own; `dimension` is
    None if it has no unit."""

    name: str
    reference: int
    factor: float
    dimension: tuple[int, int, int] | None


@dataclass(frozen=True, eq=False)
class UnitLaw(Law):
    """A law in an FMU; `home` is its model description."""

    @cached_property
    def _parameters(self) -> dict[str, Any]:
        return {_key_of(v): v for v in _real(self.home, "parameter")}

    @cached_property
    def ports(self) -> tuple[_Port, _Port]:
        """Its input and its output. Raises LawError."""
        path = str(self.path)
        given = _chosen(self.home, "input", _INPUTS, path)
        made = _chosen(self.home, "output", (_OUTPUT,), path)
        quantities = set(_DIMENSIONS) & {given.dimension}
        if given.dimension is not None and not quantities:
            raise _other_dimension(path, given, "a length, velocity, acceleration or force")
        sensed = _DIMENSIONS.get(given.dimension or _NUMBER)
        if sensed and given.name in _QUANTITIES and given.name != sensed:
            raise _other_dimension(path, given, f"that of {given.name}")
        if made.dimension not in (None, _FORCE):
            raise _other_dimension(path, made, "a force")
        return given, made

    @cached_property
    def _declared(self) -> tuple[str, type[BaseModel]]:
        """By the name or the unit of its input, and its real parameters with their bounds. Raises
        LawError."""
        given, fields = self.ports[0], dict[str, Any]()
        senses = given.name
        if senses not in _QUANTITIES:
            senses = _DIMENSIONS.get(given.dimension or _NUMBER, "any")
        for key, variable in self._parameters.items():
            description = variable.description or "of the unit"
            if variable.unit:
                description += f" ({variable.unit})"
            fields[key] = key_field(variable.start or 0.0, variable.min, variable.max, description)
        return senses, create_model("Parameters", __base__=Keys, **fields)

    def constants(self, keys: Any, about: LawContext) -> Any:
        """What is known of the run and its keys. Raises LawError for another sampling interval than
        the unit can take."""
        unit, sample_s = self.home.coSimulation, about.sample_s
        fixed_s = float(unit.fixedInternalStepSize or 0.0)
        whole = fixed_s and round(sample_s / fixed_s) * fixed_s  # FMI 3.0
        if not fixed_s and not unit.canHandleVariableCommunicationStepSize:
            experiment = self.home.defaultExperiment
            whole = fixed_s = float((experiment and experiment.stepSize) or 0.0)
        if fixed_s and abs(whole - sample_s) > _SAME_STEP * sample_s:
            raise LawError(
                f"law {self.path}: has a fixed step of {1e6 * fixed_s:g} us, but the scene samples "
                f"every {1e6 * sample_s:g} us. Export it for the scene's interval, or change "
                "sensors.every_steps."
            )
        return super().constants(keys, about)

    def bound_to(self, constants: Any, ahead: bool = True) -> BoundLaw:
        """The law with given constants; it knows nothing ahead."""
        return BoundUnit(self, constants)

    def started_with(self, constants: Any) -> dict[int, float]:
        """Values of its parameters by their references."""
        named = self._parameters.items()
        return {v.valueReference: float(getattr(constants, key)) for key, v in named}


class BoundUnit(BoundLaw):
    """The same with its constants: an instance that is made at the first sample of a run."""

    def __init__(self, law: UnitLaw, constants: Any) -> None:
        packed = pack(constants._asdict())
        state: PackedRecord = state_of(None)
        self._instance, ended = _Instance(law, constants), list[BaseException]()
        held = python_functions(self._instance, constants, state.dtype, ("command",), ended)
        super().__init__(law.name, addresses_of(held), packed, state, held, ended)

    def explain(self, samples: np.ndarray, index: int) -> str:
        """One sentence on what the unit said last, or did."""
        return f"the law {self.name}, at sample {index}, {self._instance.fault}"


@dataclass
class _Instance:
    """A running unit. Its state is inside of it: a run's samples have to come in order."""

    law: UnitLaw
    constants: Any
    fault: str = ""  # the first fault; more samples may follow before the run ends
    _unit: Any = None
    _done: int = 0
    _held: Any = None

    def command(self, p: Any, s: Any, samples: np.ndarray, i: int) -> float:
        """The command (N) after sample i."""
        try:
            if i == 0:
                self._begin()
            elif i != self._done:
                raise RuntimeError(f"sample {i} came after {self._done} samples")
            unit, step_s = self._unit, self.constants.sample_s
            given, made = self.law.ports
            _set(unit, {given.reference: float(samples[i]) / given.factor})
            unit.doStep(i * step_s, step_s)
            force = made.factor * _get(unit, made.reference)
        except Exception as error:
            self.fault = self.fault or f"failed: {error}"
            raise
        self._done = i + 1
        if not math.isfinite(force):
            self.fault = self.fault or f"commanded {force} N"
        s.mode = ACTING if force != 0.0 else WATCHING
        return force

    def _begin(self) -> None:
        self.fault = ""
        if self._unit is None:
            self._make()
        else:
            self._unit.reset()
        unit: Any = self._unit
        _set(unit, self.law.started_with(self.constants))
        if hasattr(unit, "setupExperiment"):  # of FMI 2.0
            unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.exitInitializationMode()

    def _make(self) -> None:
        import fmpy  # of an extra

        about, path = self.law.home, str(self.law.path)
        self._held = TemporaryDirectory(prefix="hertzloop-")
        fmpy.extract(path, self._held.name)
        self._unit = fmpy.instantiate_fmu(
            self._held.name, about, "CoSimulation", logger=lambda *words: None
        )


def unit_law(path: Path, name: str | None, digest: str) -> UnitLaw:
    """The only law in an FMU. Raises LawError."""
    try:
        import fmpy
    except ModuleNotFoundError:
        raise LawError(f"law {path}: needs FMPy. Run pip install 'hertzloop[interop]'.") from None
    try:
        about = fmpy.read_model_description(str(path))
        platforms = fmpy.supported_platforms(str(path))
    except Exception as error:
        message = " ".join(str(error).split())
        raise LawError(f"law {path}: is not a co-simulation unit: {message}") from error
    if about.fmiVersion == "1.0" or about.coSimulation is None:
        raise LawError(
            f"the law {path} is for FMI {about.fmiVersion}"
            f"{'' if about.coSimulation else ', model exchange'}. Export it for co-simulation, "
            "FMI 2.0 or 3.0."
        )
    if fmpy.platform not in platforms:
        raise LawError(
            f"the law {path} was built for {', '.join(platforms) or 'no platform'}, not for "
            f"{fmpy.platform}"
        )
    law = UnitLaw(path.name, path, "", digest, about)
    names = [_key_of(v) for v in _real(about, "parameter")]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise LawError(
            f"law {path}: has several parameters for the scene key {twice[0]}. Rename one of them."
        )
    return law


def _real(about: Any, causality: str) -> list[Any]:
    """Real variables, one number each, of a causality."""
    return [
        v
        for v in about.modelVariables
        if v.causality == causality and v.type in _REAL and not v.dimensions
    ]


def _key_of(parameter: Any) -> str:
    return re.sub(r"\W", "_", parameter.name).lstrip("_")


def _chosen(about: Any, causality: str, names: tuple[str, ...], path: str) -> _Port:
    """The only variable of a causality, or the only one of these names. Raises LawError."""
    found = _real(about, causality)
    named = found if len(found) == 1 else [v for v in found if v.name in names]
    if len(named) != 1:
        there = ", ".join(v.name for v in found) or "none"
        raise LawError(
            f"law {path}: has the real {causality}s {there}. Keep one, or name one "
            f"{' or '.join(names)}."
        )
    variable = named[0]
    unit = variable.unit or (variable.declaredType and variable.declaredType.unit)
    factor, dimension = 1.0, _SI.get(unit or "")
    defined = next((u.baseUnit for u in about.unitDefinitions or () if u.name == unit), None)
    if defined is not None:
        b = defined
        if b.offset or b.A or b.K or b.mol or b.cd or b.rad:
            raise _other_unit(path, variable.name, unit)
        factor, dimension = float(b.factor), (b.kg, b.m, b.s)
        if dimension == _NUMBER and factor == 1.0:
            dimension = None  # a number
    elif unit not in (None, "", "1") and dimension is None:
        raise _other_unit(path, variable.name, unit)
    return _Port(variable.name, variable.valueReference, factor, dimension)


def _other_unit(path: str, name: str, unit: str) -> LawError:
    return LawError(
        f"law {path}: the unit {unit} of {name} cannot be converted. Use m, m/s, m/s^2 or N, or "
        "define the unit by base units."
    )


def _other_dimension(path: str, port: _Port, wanted: str) -> LawError:
    return LawError(f"law {path}: the unit of {port.name} is not {wanted}. Change the unit.")


def _set(unit: Any, values: dict[int, float]) -> None:
    put = getattr(unit, "setFloat64", None) or unit.setReal
    if values:
        put(list(values), list(values.values()))


def _get(unit: Any, reference: int) -> float:
    get = getattr(unit, "getFloat64", None) or unit.getReal
    return float(get([reference])[0])
