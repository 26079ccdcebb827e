"""How kernels call each other: chosen by type, kept apart, or with one rounding."""

from collections.abc import Callable, Mapping
from functools import update_wrapper
from typing import Any

from numba import config, types
from numba.core import cgutils
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic, overload

from hertzloop.jit.decorator import kernel

# As @kernel(inline=True, borrowed=True).
_INLINE = {"_nrt": False, "forceinline": True, "no_cfunc_wrapper": True}


def by_type(kernels: Mapping[type, Callable[..., Any]]) -> Any:
    """A function of a part (a NamedTuple or None) and more that calls the kernel of its type.

    Which one is known when a caller is compiled, so the choice costs nothing at run time, and
    what a kernel returns as a constant is one in its caller. Its attribute `uncompiled` is the same
    function in Python.
    """

    def chosen(part: Any, *arguments: Any) -> Any:
        return kernels[type(part)](part, *arguments)

    def uncompiled(part: Any, *arguments: Any) -> Any:
        kernel = kernels[type(part)]
        return getattr(kernel, "py_func", kernel)(part, *arguments)

    chosen.uncompiled = uncompiled  # type: ignore[attr-defined]

    @overload(chosen, jit_options=_INLINE)
    def _compiled(part: Any, *arguments: Any) -> Any:
        found = kernels.get(_class_of(part))
        if found is None:
            return None

        # Numba wants the same names and annotations as those of the function above.
        def implementation(part: Any, *arguments: Any) -> Any:
            return found(part, *arguments)

        return implementation

    return chosen


def _class_of(part: Any) -> Any:
    """The Python class of a compiled value."""
    if isinstance(part, types.NamedTuple | types.NamedUniTuple):
        return part.instance_class
    return type(None) if isinstance(part, types.NoneType) else None


@kernel(inline=True, borrowed=True)
def yes(part):
    """True, for a choice that is settled by the type alone."""
    return True


@kernel(inline=True, borrowed=True)
def no(part):
    """False, as `yes`."""
    return False


def apart(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The kernel as a call that is never made part of its callers.

    For a long loop in a short function: within a large caller the numbers that it needs share the
    processor's registers with all the others there, and the loop fetches them again and again.
    """
    if not isinstance(kernel, Dispatcher):  # all runs as Python
        return kernel

    @intrinsic
    def call(typingctx, arguments):
        signature = typingctx.resolve_function_type(
            types.Dispatcher(kernel), tuple(arguments.types), {}
        )
        compiled = kernel.get_compile_result(signature)

        def codegen(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            context.add_linking_libs([compiled.library])
            given = cgutils.unpack_tuple(builder, values[0], len(arguments))
            given = [
                context.cast(builder, value, have, want)
                for value, have, want in zip(given, arguments, signature.args, strict=True)
            ]
            function = context.declare_function(builder.module, compiled.fndesc)
            status, result = context.call_conv.call_function(
                builder, function, signature.return_type, signature.args, given, attrs=("noinline",)
            )
            with cgutils.if_unlikely(builder, status.is_error):
                context.call_conv.return_status_propagate(builder, status)
            return result

        return signature.return_type(arguments), codegen

    def called(*arguments: Any) -> Any:
        return kernel(*arguments)

    @overload(called, jit_options=_INLINE)
    def _compiled(*arguments: Any) -> Any:
        # Numba wants the same names and annotations as those of the function above.
        def implementation(*arguments: Any) -> Any:
            return call(arguments)

        return implementation

    return update_wrapper(called, kernel)


if config.DISABLE_JIT:

    def fused(a: float, b: float, c: float) -> float:
        """a b + c; plain Python rounds twice."""
        return a * b + c

else:

    @intrinsic
    def fused(typingctx, a, b, c):
        """a b + c, rounded once."""

        def codegen(context, builder, signature, values):
            return builder.fma(*values)

        return types.float64(types.float64, types.float64, types.float64), codegen
