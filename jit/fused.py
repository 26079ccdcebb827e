"""A product and a sum that are rounded once, where a kernel is to round as NumPy does."""

from numba import config, types
from numba.extending import intrinsic

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
