"""A law's functions as C functions: compiled by Numba and kept on disk, or called back in Python.

A small module of text is written into the folder of compiled kernels, named by the digest of the
law and of that text: Numba then finds what it has compiled for that file. (It never does for a
function defined in a function.)
"""

import hashlib
import re
import sys
from collections import namedtuple
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any

import numpy as np
from llvmlite import ir
from numba import cfunc, config, from_dtype, types
from numba.core import cgutils
from numba.extending import intrinsic, is_jitted
from numba.np.numpy_support import as_dtype

from hertzloop.common.jit import kernel
from hertzloop.common.jit.arrays import array_at
from hertzloop.common.jit.folder import cache_folder, has_room, keep, kept_in

UNCOMPILED = bool(config.DISABLE_JIT)  # all runs as Python, to be tested line by line
# Result and arguments after p and s.
FUNCTIONS = {
    "command": ("double", "samples, i"),
    "known_ahead": ("int64", "samples, i"),
    "command_ahead": ("double", "samples, i, j"),
    "trigger_level": ("double", ""),
}
_TYPES = {"double": types.float64, "int64": types.int64}
_WORDS = {"f": types.float64, "i": types.int64}  # by the kind of a record's field
_ELEMENTS = {"float64": types.float64, "int64": types.int64, "bool": types.boolean}  # of an array
_SAMPLES = types.Array(types.float64, 1, "C")


def _constants(context: Any, builder: Any, kind: Any, record: np.dtype, p: Any) -> Any:
    """The parameters at `p` as the NamedTuple of type `kind` that a law sees."""

    def loaded(offset: int, in_llvm: Any) -> Any:
        at = builder.gep(start, [ir.Constant(ir.IntType(64), offset)])
        return builder.load(builder.bitcast(at, in_llvm.as_pointer()))

    word = ir.IntType(64)
    start = builder.bitcast(p, ir.IntType(8).as_pointer())
    values = []
    for name, field in zip(kind.fields, kind.types, strict=True):
        offset = record.fields[name][1]  # type: ignore[index]
        if isinstance(field, types.Array):
            address, *shape = [loaded(offset + 8 * at, word) for at in range(field.ndim + 1)]
            values.append(array_at(context, builder, field, address, shape))
        else:
            values.append(loaded(offset, ir.DoubleType() if field is types.float64 else word))
    return context.make_tuple(builder, kind, values)


def _entry(result: Any, failed: float) -> Any:
    """A call of a law's function with what came from C; gives `failed` where that raises.

    Written down as machine code would be: Numba takes many times longer to compile the same from
    Python, once a function and law.
    """

    def typed(typingctx: Any, function: Any, given: Any) -> Any:
        p, s, *more = given.types
        record = as_dtype(p.dtype)
        seen = [_constants_type(record), s.dtype, *([_SAMPLES, *more[1:]] if more else [])]
        function.dispatcher.get_call_template(tuple(seen), {})
        compiled = function.dispatcher.overloads[tuple(seen)]

        def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            at_p, at_s, *rest = cgutils.unpack_tuple(builder, values[1], len(given.types))
            state = builder.bitcast(at_s, context.get_value_type(seen[1]))
            passed = [_constants(context, builder, seen[0], record, at_p), state]
            if rest:
                count = builder.add(rest[1], context.get_constant(types.int64, 1))
                address = builder.ptrtoint(rest[0], ir.IntType(64))
                passed += [array_at(context, builder, _SAMPLES, address, [count]), *rest[1:]]
            context.add_linking_libs([compiled.library])
            status, value = context.call_internal_no_propagate(
                builder, compiled.fndesc, compiled.signature, passed
            )
            value = context.cast(builder, value, compiled.signature.return_type, result)
            return builder.select(status.is_error, context.get_constant(result, failed), value)

        return result(function, given), codegen

    @intrinsic
    def call(typingctx, function, given):
        return typed(typingctx, function, given)

    return call


call_double = _entry(types.float64, float("nan"))
call_int64 = _entry(types.int64, -1)


@lru_cache(maxsize=256)
def _constants_type(record: np.dtype) -> types.NamedTuple:
    """The type of a law's `p` of a record's fields, see `records.pack`."""
    names = record.names or ()
    kinds: list[types.Type] = []
    for name in names:
        field = record[name]
        if field.names is None:
            kinds.append(_WORDS[field.kind])
        else:
            axes = field["shape"].shape[0]
            kinds.append(types.Array(_ELEMENTS[field.names[0]], axes, "C"))
    # pyrefly: ignore[bad-class-definition]
    return types.NamedTuple(kinds, namedtuple("Constants", names))


def arguments_of(function: str) -> str:
    """Arguments of one of FUNCTIONS, as a law defines it."""
    more = FUNCTIONS[function][1]
    return f"p, s, {more}" if more else "p, s"


def _text() -> str:
    """The module that stands between C and a law's functions."""
    parts = ['"""Between the compiled loop and a law."""\n']
    for function, (result, _) in FUNCTIONS.items():
        arguments = arguments_of(function)
        parts.append(
            f"def {function}({arguments}):\n"
            f"    return call_{result}(law_{function}, ({arguments}))\n"
        )
    return "\n".join(parts)


_TEXT = _text()


class CompiledLaw:
    """A law's functions as C functions for records of these layouts, each compiled, or loaded from
    the disk, when it is first asked for.

    `trouble`: why Numba could not compile one of them, empty while it could.
    """

    def __init__(self, law: Any, parameters: np.dtype, state: np.dtype) -> None:
        for function in law.jitted:  # Numba keeps it with the values that its globals had
            function.recompile()
        self._names = [name for name in FUNCTIONS if callable(getattr(law.home, name, None))]
        layout = f"{law.name} {law.digest} {parameters} {state} {_TEXT}"
        module = ModuleType(f"hertzloop_law_{hashlib.sha256(layout.encode()).hexdigest()[:24]}")
        path = cache_folder() / "laws" / f"{module.__name__}.py"
        if not path.exists():
            keep(path, _TEXT)
        module.__file__ = str(path)
        module.__dict__.update(call_double=call_double, call_int64=call_int64)
        for name in self._names:
            called = getattr(law.home, name)
            if not is_jitted(called):
                called = kernel(called, inline=True, allocates=True, checked=True)
            module.__dict__[f"law_{name}"] = called
        # Numba looks for the module of what it loads by name.
        sys.modules[module.__name__] = module
        exec(compile(_TEXT, module.__file__, "exec"), module.__dict__)
        self._module, self._made = module, dict[str, Any]()
        self._records = types.CPointer(from_dtype(parameters)), types.CPointer(from_dtype(state))
        self._refused = Path(module.__file__).with_suffix(".refused")
        self.trouble = ""
        if self._refused.exists():  # Numba takes seconds to say so
            self.trouble = self._refused.read_text(encoding="utf-8")

    def addresses(self, wanted: Iterable[str]) -> dict[str, int]:
        """Addresses of those of the functions that the law has; none if one was refused."""
        wanted = [name for name in wanted if name in self._names]
        try:
            for name in wanted:
                if not self.trouble and name not in self._made:
                    self._made[name] = self._compiled(name)
        except Exception as error:  # whatever Numba does not know: there is Python instead
            if "no compiled object yet" in str(error):  # Ctrl-C was lost in a call from LLVM
                raise KeyboardInterrupt from error
            self.trouble = _first_line(error, name)
            keep(self._refused, self.trouble)
        if self.trouble:
            return {}
        return {name: self._made[name].address for name in wanted}

    def _compiled(self, name: str) -> Any:
        result, more = FUNCTIONS[name]
        words = (types.int64,) * more.count(",")
        samples = (types.CPointer(types.float64),) if more else ()
        signature = _TYPES[result](*self._records, *samples, *words)
        function = self._module.__dict__[name]
        with kept_in(cache_folder()):
            return cfunc(signature, cache=has_room(), error_model="numpy")(function)


def _first_line(error: Exception, function: str) -> str:
    """What Numba complains about, in a line: the innermost error, since those around it speak of
    our functions, and the line of the law, or the function where that is not said."""
    inner = re.sub(r"\x1b\[\d+m", "", str(error)).rpartition("(step: nopython frontend)")[2]
    lines = [line.strip() for line in inner.splitlines()]
    lines = [line for line in lines if line and not line.startswith(("Failed in", "During:"))]
    reasons = [line for line in lines if not line.startswith(">>>")]
    if reasons and reasons[0].endswith(":"):  # the types of the arguments follow
        reasons[0] += next((line[3:] for line in lines if line.startswith(">>>")), "")
    at = re.search(r"^ *File (?!.*hertzloop_law_).*, (line \d+):", inner, re.MULTILINE)
    return (
        f"{reasons[0] if reasons else type(error).__name__} ({at[1] if at else 'in ' + function})"
    )


# By name and digest of the law and by the layouts, which are kept and thus known by identity.
_ENTRIES: dict[tuple[str, str, int, int], tuple[CompiledLaw, np.dtype, np.dtype]] = {}
_compiling = Lock()  # threads that meet a new law at once would each compile it, and drop others'


def compiled_law(
    law: Any, parameters: np.dtype, state: np.dtype, wanted: Iterable[str]
) -> tuple[CompiledLaw, dict[str, int]]:
    """The compiled functions of a `Law` for these layouts, made once, and the addresses of those
    `wanted`."""
    key = (law.name, law.digest, id(parameters), id(state))
    with _compiling:
        if key not in _ENTRIES:
            _ENTRIES[key] = CompiledLaw(law, parameters, state), parameters, state
        found = _ENTRIES[key][0]
        return found, found.addresses(wanted)
