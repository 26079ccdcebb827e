"""How kernels call each other: chosen by type, kept apart, or with one rounding."""

import sys
from collections.abc import Callable, Mapping
from functools import update_wrapper
from typing import Any

from numba import config, types
from numba.core import cgutils
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.typing.templates import infer_global
from numba.extending import intrinsic, models, overload, register_model

from hertzloop.common.jit.decorator import kernel
from hertzloop.common.uncompiled import plain


def by_type(kernels: Mapping[type, Callable[..., Any]]) -> Any:
    """A function of a part (a NamedTuple or None) and more that calls the kernel of its type.

    Which one is known when a caller is compiled, so the choice costs nothing at run time, and
    what a kernel returns as a constant is one in its caller. Its attribute `uncompiled` is the same
    function in Python.
    """
    return _function_of(kernels.get)


def by_module(name: str, otherwise: Callable[..., Any] | None = None) -> Any:
    """The same with the kernel `name` of the module that defines the part's class; `otherwise`
    where that module has none."""

    def kernel_of(part: Any) -> Any:
        module = sys.modules.get(getattr(part, "__module__", ""))
        return getattr(module, name, otherwise)

    return _function_of(kernel_of)


def _function_of(kernel_of: Callable[[Any], Any]) -> Any:
    """A function that calls the kernel that `kernel_of` finds for a part's class, None if none."""

    def chosen(part: Any, *arguments: Any) -> Any:
        return kernel_of(type(part))(part, *arguments)

    def uncompiled(part: Any, *arguments: Any) -> Any:
        kernel = kernel_of(type(part))
        return plain(kernel)(part, *arguments)

    chosen.uncompiled = uncompiled  # type: ignore[attr-defined]
    infer_global(chosen, _ByType(kernel_of))
    return chosen


class _ByType(types.Callable, types.Dummy):
    """The type of a function by type: a call of it is one of the kernel that it chooses, with no
    function between that would be compiled for each choice."""

    def __init__(self, kernel_of: Callable[[Any], Any]) -> None:
        self._kernel_of = kernel_of
        super().__init__(f"by_type({id(kernel_of)})")

    def _chosen(self, arguments: tuple[Any, ...]) -> Any:
        found = self._kernel_of(_class_of(arguments[0]))
        return found and cpu_target.typing_context.resolve_value_type(found)

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """The signature of a call, or None where there is no kernel for the type."""
        chosen = self._chosen(args)
        return chosen and chosen.get_call_type(context, args, kws)

    def get_call_signatures(self) -> tuple[Any, bool]:
        """Signatures to name in an error."""
        return (), True

    def get_impl_key(self, sig: Any) -> Any:
        """What finds the compiled kernel for a signature."""
        return self._chosen(sig.args).get_impl_key(sig)


register_model(_ByType)(models.OpaqueModel)


def _class_of(part: Any) -> Any:
    """The Python class of a compiled value."""
    if isinstance(part, types.NamedTuple | types.NamedUniTuple):
        return part.instance_class
    return type(None) if isinstance(part, types.NoneType) else None


# Choices that are settled by the type alone.


@kernel(inline=True)
def yes(part, *others):
    """True."""
    return True


@kernel(inline=True)
def no(part, *others):
    """False."""
    return False


@kernel(inline=True)
def zero(part, *others):
    """0.0, what something that is not there adds."""
    return 0.0


@kernel(inline=True)
def nothing(part, *others):
    """Does nothing."""


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

    # As @kernel(inline=True).
    @overload(called, jit_options={"_nrt": False, "forceinline": True, "no_cfunc_wrapper": True})
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
