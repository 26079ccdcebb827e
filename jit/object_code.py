"""Compiled kernels as object code that needs no Python: for a linker, on this machine or another.

Which processor it is for, Numba's settings say: NUMBA_CPU_NAME and NUMBA_CPU_FEATURES, before it is
imported.
"""

from collections.abc import Callable, Mapping
from typing import Any

import llvmlite.binding as ll
from numba.core.registry import cpu_target

from jit import kernel

# What a caller in C sees of a function f(a, b): int32_t f(void **result, void **fault, a, b), which
# returns 0. There has to be room for a result, though it is none.


def object_code(functions: Mapping[str, tuple[Callable[..., None], tuple[Any, ...]]]) -> bytes:
    """Object code of functions that return nothing, with their argument types, under the names
    that they are given by: position independent, no other name to be seen."""
    whole, found = None, {}
    for name, (function, arguments) in functions.items():
        compiled = _compiled(function, arguments)
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


def _compiled(function: Callable[..., None], arguments: tuple[Any, ...]) -> Any:
    dispatcher = kernel(function, borrowed=True, bare=True, kept=False)
    dispatcher.compile(arguments)
    return dispatcher.overloads[arguments]
