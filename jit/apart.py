"""Compiled kernels that stay a function of their own inside whoever calls them."""

from collections.abc import Callable
from functools import update_wrapper
from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic, overload


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

    @overload(called, jit_options={"_nrt": False, "forceinline": True})
    def _compiled(*arguments: Any) -> Any:
        # Numba wants the same names and annotations as those of the function above.
        def implementation(*arguments: Any) -> Any:
            return call(arguments)

        return implementation

    return update_wrapper(called, kernel)
