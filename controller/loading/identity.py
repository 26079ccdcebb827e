"""What identifies a law: the code of every function that it calls, and every value that they read.

Numba compiles the values of a function's globals and closures into its machine code. The text of a
law does not tell these values: they may come from a file, the environment or another module.
"""

import builtins
import functools
import hashlib
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from itertools import count
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher

from hertzloop.common.uncompiled import plain
from hertzloop.controller.loading.compiled import FUNCTIONS

# Functions that prepare a run, and what a law declares. They are never compiled.
_PREPARING = ("prepare", "force_bound", "transfer_function", "tune", "note")
_DECLARED = ("senses", "latches", "open_loop", "not_linear")
# The name of a function of these modules tells what it does, together with the versions of a run.
_LIBRARIES = {
    "_bisect",
    "_functools",
    "_operator",
    "_statistics",
    "bisect",
    "builtins",
    "cmath",
    "collections",
    "functools",
    "hertzloop",
    "itertools",
    "llvmlite",
    "math",
    "numba",
    "numpy",
    "operator",
    "scipy",
    "statistics",
    "typing",
}
_READS_FILES = {"fromfile", "genfromtxt", "input", "load", "loadtxt", "memmap", "open"}
_SIMPLE = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), range, slice)


TEXT_DIGITS = 16  # of a law's digest, which tell its text; the others tell its identity
_UNKNOWN = "unknown"
_unknown_laws = count(1)


def law_digest(text: str, identity: "Identity") -> str:
    """Return the digest of a law, 32 characters, from that of its text.

    If the identity is unknown, it is another one each time that the law is loaded.
    """
    told = identity.digest
    if identity.unknown:
        told = f"{_UNKNOWN}{next(_unknown_laws):0{len(told) - len(_UNKNOWN)}d}"
    return text[:TEXT_DIGITS] + told


def same_law(one: str, other: str) -> bool:
    """Whether two digests are those of the same law, as far as that is known."""
    texts = {digest[:TEXT_DIGITS] for digest in (one, other)}
    unknown = all(digest[TEXT_DIGITS:].startswith(_UNKNOWN) for digest in (one, other))
    return one == other or (len(texts) == 1 and unknown)


@dataclass(frozen=True)
class Identity:
    """The identity of the code and the values of a law.

    Attributes:
        digest: 16 hexadecimal digits.
        unknown: the first global whose value cannot be told, with its kind; empty if all can.
        values: a digest for each global that the compiled functions read, by its name. It covers
            the globals before it as well: the first difference names the global that changed.
        dispatchers: Numba's dispatchers among the functions that the law calls.
    """

    digest: str
    unknown: str
    values: dict[str, bytes]
    dispatchers: tuple[Dispatcher, ...]

    def changed(self, other: "Identity") -> str:
        """Return the name of the first global whose value differs; empty if none does."""
        both = zip(self.values.items(), other.values.items(), strict=False)
        return next((name for (name, one), (_, two) in both if one != two), "")


def identify(home: Any) -> Identity:
    """Return the identity of the law in a module or a class, as its values are now."""
    law, prepared = _Walk(strict=True), _Walk(strict=False)
    for name in FUNCTIONS:
        law.add(name, getattr(home, name, None))
    for name in (*_PREPARING, *_DECLARED):
        prepared.add(name, getattr(home, name, None))
    for name, value in vars(getattr(home, "State", object)).items():
        if not name.startswith("__"):
            prepared.add(name, value)
    digest = hashlib.sha256(law.digest.digest() + prepared.digest.digest()).hexdigest()
    return Identity(digest[:16], law.unknown, law.values, tuple(law.dispatchers))


@dataclass
class _Walk:
    """Adds values to a digest, and whatever the functions among them read.

    Attributes:
        strict: whether a value that can change unseen, as a list can, makes the identity unknown.
            Otherwise the contents of lists, sets and dicts count, and of other values their type.
    """

    strict: bool
    digest: Any = field(default_factory=hashlib.sha256)
    unknown: str = ""
    values: dict[str, bytes] = field(default_factory=dict)
    dispatchers: list[Dispatcher] = field(default_factory=list)
    _seen: dict[int, tuple[int, Any]] = field(default_factory=dict)  # the object stays alive
    _read: set[tuple[int, tuple[str, ...]]] = field(default_factory=set)

    def add(self, name: str, value: Any) -> None:
        """Add a value that the law calls `name`."""
        if isinstance(value, float):
            self._put(type(value).__name__, value.hex())
        elif isinstance(value, _SIMPLE):
            self._put(type(value).__name__, value)
        elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
            array = np.asarray(value)
            layout = array.flags.c_contiguous, array.flags.f_contiguous
            self._put(type(value).__name__, array.dtype.descr, array.shape, layout)
            self.digest.update(array.tobytes())
        elif isinstance(value, tuple):
            self._put("tuple", getattr(value, "_fields", None), len(value))
            self._add_all(name, value)
        elif isinstance(value, frozenset):  # as a constant of code
            self._put("frozenset", sorted(map(repr, value)))
        elif not self._seen_before(value):
            self._add_object(name, value)

    def _add_all(self, name: str, values: Iterable[Any]) -> None:
        for value in values:
            self.add(name, value)

    def _put(self, *words: Any) -> None:
        self.digest.update(repr(words).encode() + b"\0")

    def _cannot_tell(self, name: str, kind: str) -> None:
        self._put("unknown", kind)
        self.unknown = self.unknown or f"{name} is {kind}"

    def _seen_before(self, value: Any) -> bool:
        """Whether this object was added before; functions may call each other in a circle."""
        if id(value) in self._seen:
            self._put("again", self._seen[id(value)][0])
            return True
        self._seen[id(value)] = len(self._seen), value
        return False

    def _add_object(self, name: str, value: Any) -> None:
        if isinstance(value, FunctionType | Dispatcher):
            self._add_function(name, value)
        elif isinstance(value, functools.partial):
            self._put("partial", len(value.args), sorted(value.keywords))
            self._add_all(name, [value.func, *value.args])
            self._add_all(name, [value.keywords[key] for key in sorted(value.keywords)])
        elif isinstance(value, np.ufunc):
            self._add_by_name(name, "numpy", value.__name__)
        elif isinstance(value, BuiltinFunctionType):
            self._add_by_name(name, value.__module__, value.__name__)
        elif isinstance(value, functools._lru_cache_wrapper):
            self.add(name, value.__wrapped__)
        elif isinstance(value, Enum):
            self._put("enum", type(value).__qualname__, value.name)
            self.add(name, value.value)
        elif isinstance(value, ModuleType):  # what the law reads of it is added beside it
            self._put("module", value.__name__)
        elif isinstance(value, type):
            self._add_class(name, value)
        elif isinstance(value, types.Type):  # of Numba
            self._put("type", str(value))
        elif _is_library(getattr(value, "__module__", None)) and hasattr(value, "__name__"):
            self._add_by_name(name, value.__module__, value.__name__)  # as np.max
        elif not self.strict and isinstance(value, list | dict | set):
            items = value if isinstance(value, list) else sorted(value, key=repr)
            self._put(type(value).__name__, len(items))
            for item in items:
                self.add(name, item)
                self.add(name, value[item] if isinstance(value, dict) else None)
        else:
            self._cannot_tell(name, f"a {type(value).__name__}")

    def _add_function(self, name: str, function: Any) -> None:
        python = plain(function)
        module = python.__module__ or ""
        if _is_library(module) or module.partition(".")[0] in sys.stdlib_module_names:
            self._add_by_name(name, module, python.__qualname__)
            return
        if isinstance(function, Dispatcher):
            self.dispatchers.append(function)
            options = function.targetoptions.items()
            self._put(sorted((k, sorted(v) if isinstance(v, set) else v) for k, v in options))
        self._add_all(name, python.__defaults__ or ())
        self._add_all(name, [value for _, value in sorted((python.__kwdefaults__ or {}).items())])
        cells = python.__closure__ or ()
        for variable, cell in zip(python.__code__.co_freevars, cells, strict=True):
            try:
                self._add_read(variable, cell.cell_contents)
            except ValueError:
                self._cannot_tell(variable, "a variable without a value")
        self._add_code(python.__code__, python.__globals__)

    def _add_by_name(self, name: str, module: str | None, function: str) -> None:
        if not _is_library(module) or function in _READS_FILES:
            self._cannot_tell(name, f"the function {'.'.join(filter(None, (module, function)))}")
        self._put("function", module, function)

    def _add_class(self, name: str, value: type) -> None:
        self._put("class", value.__module__, value.__qualname__, getattr(value, "_fields", None))
        if _is_library(value.__module__):
            return
        if type(value).__module__.startswith("numba"):
            self._cannot_tell(name, "a jitclass")
        if issubclass(value, Enum):
            self._add_all(name, value)
            return
        methods = (v for _, v in sorted(vars(value).items()) if isinstance(v, FunctionType))
        self._add_all(name, methods)

    def _add_code(self, code: CodeType, names: dict[str, Any]) -> None:
        self._put(code.co_code, code.co_names, code.co_varnames, code.co_argcount, code.co_flags)
        for constant in code.co_consts:
            if isinstance(constant, CodeType):  # a function in it, or a comprehension
                self._add_code(constant, names)
            else:
                self.add("", constant)
        for name in code.co_names:  # of globals and of attributes
            if name in names:
                self._add_global(name, names[name], code.co_names)
            elif name in _READS_FILES and hasattr(builtins, name):
                self._cannot_tell(name, "a function that reads a file")

    def _add_global(self, name: str, value: Any, names: tuple[str, ...]) -> None:
        """Add a global, and of a module or a class those attributes that `names` may read."""
        self._add_read(name, value)
        if not isinstance(value, ModuleType | type) or (id(value), names) in self._read:
            return
        self._read.add((id(value), names))
        for attribute in names:
            if attribute in vars(value):
                self._add_global(f"{name}.{attribute}", vars(value)[attribute], names)

    def _add_read(self, name: str, value: Any) -> None:
        self.add(name, value)
        self.values[name] = self.digest.digest()


def _is_library(module: str | None) -> bool:
    """Whether the name of a function of this module tells what it does."""
    top, _, rest = (module or "").partition(".")
    return top in _LIBRARIES and not (top == "numpy" and "random" in rest)
