"""Compiled kernels as object code that needs no Python: for a linker, on this machine or another.

Which processor it is for, Numba's settings say: NUMBA_CPU_NAME and NUMBA_CPU_FEATURES, before it is
imported.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import llvmlite.binding as ll
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.registry import cpu_target
from numba.extending import intrinsic

from hertzloop.common.jit import kernel
from hertzloop.common.jit.arrays import array_at

# What a caller in C sees of a function f(a, b): int32_t f(void **result, void **fault, a, b), which
# returns 0. There has to be room for a result, though it is none.


def object_code(functions: Mapping[str, tuple[Callable[..., None], tuple[Any, ...]]]) -> bytes:
    """Object code of functions that return nothing, with their argument types, under the names
    that they are given by: position independent, no other name to be seen."""
    whole, found = None, {}
    for name, (function, arguments) in functions.items():
        dispatcher = kernel(function)
        dispatcher.compile(arguments)
        compiled = dispatcher.overloads[arguments]
        found[compiled.fndesc.llvm_func_name] = name
        module = ll.parse_assembly(compiled.library.get_llvm_str())
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    assert whole is not None
    for value in [*whole.functions, *whole.global_variables]:
        if value.name in found:
            value.name, value.linkage = found[value.name], "external"
            value.visibility = "hidden"  # outside of what it is linked into
        elif not value.is_declaration:
            value.linkage = "internal"
    _, cpu, features = cpu_target.target_context.codegen().magic_tuple()
    machine = ll.Target.from_default_triple().create_target_machine(
        cpu=cpu, features=features, opt=3, reloc="pic", codemodel="default"
    )
    passes = ll.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(whole, ll.create_pass_builder(machine, ll.create_pipeline_tuning_options()))
    return bytes(machine.emit_object(whole))


# Parts of kernels as one table of machine words, for callers that are not Python.
#
# A part is a number, a bool, None, an array, or a NamedTuple of parts. In the table a number is
# one word, an array the address of its first element and the length of every axis, None nothing.

WORD = 8  # bytes


def leaves(part: Any) -> Iterator[Any]:
    """Numbers, bools and arrays of a part, in the order of their words."""
    if isinstance(part, tuple):
        for inner in part:
            yield from leaves(inner)
    elif part is not None:
        yield part


def outline(part: Any) -> Any:
    """The same part, of the same compiled type, with empty arrays."""
    if isinstance(part, tuple):
        return type(part)(*(outline(inner) for inner in part))
    if isinstance(part, np.ndarray):
        if not (part.flags.c_contiguous and part.flags.writeable):
            raise ValueError(f"an array of shape {part.shape} is no plain block of memory")
        return np.empty((0,) * part.ndim, part.dtype)
    return part


def assembler(kind: types.Type) -> Any:
    """A compiled function of the address of a table that puts the part of this type together."""

    @intrinsic
    def assembled(typingctx, address):
        signature = kind(types.intp)

        def codegen(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            table = builder.inttoptr(values[0], ir.IntType(64).as_pointer())
            part, _ = _built(context, builder, kind, table, 0)
            return part

        return signature, codegen

    return assembled


def _built(context: Any, builder: Any, kind: Any, table: Any, at: int) -> tuple[Any, int]:
    """The value of a part whose words begin at index `at`, and the index after them."""

    def word(index: int) -> Any:
        return builder.load(builder.gep(table, [ir.Constant(ir.IntType(64), index)]))

    if isinstance(kind, types.BaseTuple):
        items = []
        for inner in kind.types:
            item, at = _built(context, builder, inner, table, at)
            items.append(item)
        return context.make_tuple(builder, kind, items), at
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value(), at
    if isinstance(kind, types.Float):
        return builder.bitcast(word(at), ir.DoubleType()), at + 1
    if isinstance(kind, types.Boolean):
        return builder.icmp_unsigned("!=", word(at), ir.Constant(ir.IntType(64), 0)), at + 1
    if isinstance(kind, types.Integer):
        return word(at), at + 1
    if not isinstance(kind, types.Array):
        raise TypeError(f"{kind} has no place in a table of words")
    shape = [word(at + 1 + axis) for axis in range(kind.ndim)]
    return array_at(context, builder, kind, word(at), shape), at + 1 + kind.ndim
