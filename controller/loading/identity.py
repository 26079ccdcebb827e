"""What identifies a law: the text of its files, and every value that its functions read.

Numba compiles the values of a function's globals and closures into its machine code. The text of a
law does not tell these values: they may come from a file, the environment or another module.
"""

import ast
import hashlib
import inspect
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from hertzloop.common.text_files import python_text
from hertzloop.common.uncompiled import plain
from hertzloop.controller.loading.compiled import FUNCTIONS

SHIPPED = Path(__file__).resolve().parent.parent / "laws"  # the laws that come with hertzloop
TEXT_DIGITS = 16  # of a law's digest, which tell its text; the others tell its values

# What a law defines beside FUNCTIONS. None of it is compiled.
_DECLARED = (
    *("prepare", "force_bound", "transfer_function", "tune", "note"),
    *("senses", "latches", "open_loop", "not_linear"),
)
# What a function of these does follows from its name and the versions of a run.
_LIBRARIES = {"hertzloop", "llvmlite", "numba", "numpy", "scipy", *sys.stdlib_module_names}
_SIMPLE = (bool, int, float, complex, str, bytes, type(None))


def text_digest(path: Path) -> str:
    """Return the digest of a law's file and, for Python, of all files of its folder and shipped
    laws that it imports. It is known before any of it is executed.

    Raises OSError, SyntaxError or ValueError.
    """
    found, waiting = {path}, [path] if path.suffix == ".py" else []
    while waiting:
        file = waiting.pop()
        for name in _imported(ast.parse(python_text(file.read_bytes()), str(file))):
            used = {folder / name for folder in (path.parent, SHIPPED)} - found
            waiting += (new := [other for other in used if other.is_file()])
            found.update(new)
    total = hashlib.sha256()
    for file in [path, *sorted(found - {path}, key=lambda file: file.name)]:
        content = file.read_bytes()
        total.update(f"{file.name} {len(content)}\n".encode() + content)
    return total.hexdigest()[:32]


def _imported(tree: ast.Module) -> Iterator[str]:
    """Paths that a module of a folder may have, if it is among those that are imported."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Import | ast.ImportFrom):
            continue
        home = f"{getattr(node, 'module', None) or ''}."
        for name in (home, *(f"{home}{alias.name}" for alias in node.names)):
            words = name.strip(".").split(".")
            yield from (f"{'/'.join(words[first:])}.py" for first in range(len(words)))


@dataclass(frozen=True)
class Identity:
    """The values that identify a law beside its text.

    Attributes:
        digest: 16 hexadecimal digits.
        values: what the compiled functions read, by module and name.
        jitted: functions among them that the law has had compiled by Numba itself.
    """

    digest: str
    values: dict[tuple[str, str], str]
    jitted: tuple[Any, ...]

    def changed(self, other: "Identity") -> str:
        """Return the name of a value that differs; empty if none does."""
        both = self.values.keys() & other.values.keys()
        return min((key[1] for key in both if self.values[key] != other.values[key]), default="")


def identify(home: Any) -> Identity:
    """Return the identity of the law in a module or a class, as its values are now."""
    compiled, other = _Values(), _Values()
    for name in FUNCTIONS:
        compiled.add("", name, getattr(home, name, None))
    state = vars(getattr(home, "State", object))
    for name in _DECLARED:
        other.add("", name, getattr(home, name, None))
    for name in (name for name in state if not name.startswith("__")):
        other.add("State", name, state[name])
    told = repr([(values.values, values.code) for values in (compiled, other)])
    digest = hashlib.sha256(told.encode()).hexdigest()[:16]
    return Identity(digest, compiled.values, tuple(compiled.jitted))


@dataclass
class _Values:
    """The values that functions read, as text by module and name; their code; and those that are
    Numba's own."""

    values: dict[tuple[str, str], str] = field(default_factory=dict)
    code: list[str] = field(default_factory=list)
    jitted: list[Any] = field(default_factory=list)
    _read: dict[Any, Any] = field(default_factory=dict)  # by identity; the objects stay alive

    def add(self, module: str, name: str, value: Any, read: Iterable[str] = ()) -> None:
        """Add a value that functions of a module call `name`, and of a module or a class what they
        `read` of it."""
        self.values[module, name] = self._told(value)
        if isinstance(value, ModuleType | type) and not _in_library(value):
            attributes = frozenset(name for name in read if name in vars(value))
            if self._is_new(value, attributes):
                for attribute in sorted(attributes):
                    self.add(module, f"{name}.{attribute}", vars(value)[attribute], read)

    def _told(self, value: Any, within: tuple[int, ...] = ()) -> str:
        """A value as text; functions are read on the way."""

        def each(values: Iterable[Any]) -> list[str]:
            return [self._told(part, (*within, id(value))) for part in values]

        kind = type(value).__qualname__
        if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
            array = np.asarray(value)
            order = array.flags.c_contiguous, array.flags.f_contiguous
            content = hashlib.sha256(array.tobytes()).hexdigest()
            return f"{kind} {array.dtype.descr} {array.shape} {order} {content}"
        if isinstance(value, _SIMPLE):
            return f"{kind} {value!r}"
        if id(value) in within:
            return "itself"
        if isinstance(value, tuple | list):
            return f"{kind} {getattr(value, '_fields', '')} {each(value)}"
        if isinstance(value, dict):
            return f"{kind} {each(value.items())}"
        if isinstance(value, set | frozenset):
            return f"{kind} {sorted(each(value))}"
        if hasattr(value, "__qualname__"):
            self._read_function(value)
            return f"{value.__module__}.{value.__qualname__}"
        try:
            return f"{kind} {each(value.__reduce_ex__(2))}"
        except Exception:  # a module, or a lock: it has no value
            return kind

    def _read_function(self, function: Any) -> None:
        python = inspect.unwrap(function)
        if not isinstance(python, FunctionType) or _in_library(python) or not self._is_new(python):
            return
        if plain(function) is not function:
            self.jitted.append(function)
        codes = list(_codes(python.__code__))
        read = {name for code in codes for name in code.co_names}
        for code in codes:
            constants = [part for part in code.co_consts if not isinstance(part, CodeType)]
            self.code.append(repr((code.co_code, code.co_names, self._told(constants))))
        module = python.__module__
        defaults = python.__defaults__, python.__kwdefaults__
        self.add(module, f"the defaults of {python.__name__}", defaults)
        cells = zip(python.__code__.co_freevars, python.__closure__ or (), strict=True)
        for name, cell in cells:
            if cell != CellType():  # an empty one
                self.add(module, name, cell.cell_contents, read)
        for name in sorted(read & python.__globals__.keys()):
            self.add(module, name, python.__globals__[name], read)

    def _is_new(self, value: Any, attributes: Iterable[str] = ()) -> bool:
        """Whether this object was not read before; functions may call each other in a circle."""
        key = id(value), attributes
        new = key not in self._read
        self._read[key] = value
        return new


def _codes(code: CodeType) -> Iterator[CodeType]:
    """The code of a function and of the functions and comprehensions in it."""
    yield code
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _codes(part)


def _in_library(value: Any) -> bool:
    """Whether a module, or what it defines, follows from its name."""
    name = value.__name__ if isinstance(value, ModuleType) else value.__module__ or ""
    return name.partition(".")[0] in _LIBRARIES
