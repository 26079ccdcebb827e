"""A law as it was found: its scene keys, what it senses, its text, digest and identity."""

import math
from collections import namedtuple
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from annotated_types import Ge, Le
from pydantic import BaseModel, Field

from hertzloop.controller.law import WHOLE_STEPS, ForceBound, Keys, LawContext, LawError, Response
from hertzloop.controller.loading.bound import BoundLaw, BoundPython
from hertzloop.controller.loading.identity import Identity, identify

# What a law without `prepare` knows of the run, besides its keys.
ABOUT_FIELDS = (
    "sample_s",
    "loop_delay_s",
    "stiffness",
    "sphere_mass_kg",
    "impact_speed_m_s",
    "impedance_n_s_m",
    "converter_step",
    "limit_n",
)


@dataclass(frozen=True, eq=False)
class Law:
    """A law written in Python. `home` is the module, or the class in it, with its functions.
    A law that is loaded again is another one: what it prepares may have changed.

    Attributes:
        name: Name of the law, or path of its file.
        path: File of the law.
        source: Text of the file.
        digest: Digest of text and values; of the file alone for a shipped law or a library.
        home: Module or class with the functions of the law.
        identity: Values that the law's functions read; None for a shipped law or a library.

    A law declares `senses`, `latches`, `open_loop` and `not_linear` by these names
    in its module or class.
    """

    name: str
    path: Path
    source: str
    digest: str
    home: Any = field(repr=False, compare=False)
    identity: Identity | None = field(default=None, repr=False, compare=False)
    _prepared: list[Identity] = field(default_factory=list, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Read the declaration now, so that an error in it appears when the law is loaded."""
        _ = self._declared

    @cached_property
    def _declared(self) -> tuple[str, type[BaseModel]]:
        """Sensed quantity and model of the scene keys."""
        return str(getattr(self.home, "senses", "xi")), getattr(self.home, "Parameters", Keys)

    @cached_property
    def keys(self) -> type[BaseModel]:
        """Model of the scene keys of the law."""
        return self._declared[1]

    @cached_property
    def key_names(self) -> tuple[str, ...]:
        """Names of its scene keys."""
        return tuple(self.keys.model_fields)

    @cached_property
    def whole_steps(self) -> list[str]:
        """Keys that must be a whole number of steps."""
        return [k for k, info in self.keys.model_fields.items() if WHOLE_STEPS in info.metadata]

    @cached_property
    def senses(self) -> str:
        """Quantity that the law needs; "any" if it accepts each.

        Of several, separated by commas, the first is the default.
        """
        return self._declared[0]

    @cached_property
    def latches(self) -> bool:
        """Whether the delay in its state is latched at a threshold."""
        return bool(getattr(self.home, "latches", False))

    @cached_property
    def open_loop(self) -> bool:
        """Whether its forces are known before the run, so that it has no feedback."""
        return bool(getattr(self.home, "open_loop", False))

    @cached_property
    def not_linear(self) -> str:
        """Why it is not linear, as a clause for a message; empty if it may be."""
        if self.open_loop:
            return "its force is computed before the run and does not depend on the samples"
        return str(getattr(self.home, "not_linear", ""))

    @property
    def jitted(self) -> tuple[Any, ...]:
        """Functions that it calls and has had compiled by Numba itself."""
        return self.identity.jitted if self.identity else ()

    def note(self, keys: Any) -> str:
        """A sentence on its keys that a user should read before a run; usually empty."""
        return str(self._asked("note", keys) or "")

    def force_bound(self, keys: Any) -> ForceBound:
        """How far its force can go; without limit if it does not say. Raises LawError."""
        found = (
            self._asked("force_bound", keys) if hasattr(self.home, "force_bound") else ForceBound()
        )
        if not isinstance(found, ForceBound):
            raise LawError(f"law {self.name}: force_bound returned {found!r}. Return a ForceBound.")
        return found

    def response(self, keys: Any, constants: Any) -> Response | None:
        """Its transfer function; None if it does not declare one. Raises LawError."""
        return self._asked("transfer_function", keys, constants)

    def ranges(self, about: LawContext) -> dict[str, tuple[float, float]]:
        """Ranges that a search takes for its keys: what it says, else their bounds. Raises
        LawError."""
        if hasattr(self.home, "tune"):
            result = self._asked("tune", about)
            try:
                return {str(key): (float(low), float(high)) for key, (low, high) in result.items()}
            except (AttributeError, TypeError, ValueError):
                raise LawError(
                    f"law {self.name}: tune returned {result!r}. Return {{key: (low, high)}}."
                ) from None
        found = {}
        for name, info in self.keys.model_fields.items():
            low = next((float(m.ge) for m in info.metadata if isinstance(m, Ge)), math.nan)  # type: ignore[arg-type]
            high = next((float(m.le) for m in info.metadata if isinstance(m, Le)), math.nan)  # type: ignore[arg-type]
            if low < high:
                found[name] = (low, high)
        return found

    def constants(self, keys: Any, about: LawContext) -> Any:
        """What its functions see as `p`. Raises LawError."""
        if hasattr(self.home, "prepare"):
            found = self._asked("prepare", keys, about)
            if not hasattr(found, "_asdict"):
                raise LawError(
                    f"law {self.name}: prepare returned {type(found).__name__}. Return a "
                    "NamedTuple of numbers and arrays."
                )
            self._check_values()
            return found
        kinds = int | float | tuple | np.ndarray
        own = {key: value for key, value in vars(keys).items() if isinstance(value, kinds)}
        known = (getattr(about, name) for name in ABOUT_FIELDS)
        return _constants_of((*ABOUT_FIELDS, *own))(*known, *own.values())

    def _check_values(self) -> None:
        """Refuse a law whose `prepare` changes what its compiled functions read: they keep the
        values that they were compiled with. Raises LawError."""
        if self.identity is None or len(self._prepared) >= _PREPARES_CHECKED:
            return
        self._prepared.append(now := identify(self.home))
        if changed := self.identity.changed(now):
            raise LawError(
                f"law {self.name}: prepare changes the global {changed}, which the law reads. "
                "Return its value from prepare; the law reads it from p."
            )

    def _asked(self, function: str, *about: Any) -> Any:
        """What one of its functions says before a run, None without it. Raises LawError."""
        try:
            asked = getattr(self.home, function, None)
            return None if asked is None else asked(*about)
        except LawError:
            raise
        except (Exception, SystemExit) as error:
            result = error_text(error, self.path)
            raise LawError(f"law {self.name}: {function} failed: {result}") from error

    def bind(self, keys: Any, about: LawContext, ahead: bool = True) -> BoundLaw:
        """The law with its constants; without `ahead` its commands alone. Raises LawError."""
        return self.bound_to(self.constants(keys, about), ahead)

    def bound_to(self, constants: Any, ahead: bool = True) -> BoundLaw:
        """The law with given constants. Raises LawError."""
        try:
            return BoundPython(self, constants, ahead)
        except TypeError as error:
            raise LawError(f"law {self.name}: is invalid: {error}") from error


_PREPARES_CHECKED = 4  # the first: it takes 0.1 ms, and a sweep prepares a law in each case


def error_text(error: BaseException, path: Path) -> str:
    """An exception, with the line of the law's file."""
    trace, line = error.__traceback__, None
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            line = trace.tb_lineno
        trace = trace.tb_next
    result = ": ".join(filter(None, (type(error).__name__, str(error))))
    return result + (f" (line {line})" if line else "")


@lru_cache(maxsize=64)
def _constants_of(names: tuple[str, ...]) -> Any:
    # pyrefly: ignore[bad-class-definition]
    return namedtuple("Constants", names)


def key_field(start: Any, low: Any, high: Any, description: str) -> tuple[type[float], Any]:
    """A scene key of a law that is not written in Python, within bounds that may be None."""
    low, high = (None if bound is None else float(bound) for bound in (low, high))
    return float, Field(float(start), ge=low, le=high, description=description)
