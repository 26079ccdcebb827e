"""Functions of compiled kernels that are chosen by the type of their first argument."""

from collections.abc import Callable, Mapping
from typing import Any

from numba import types
from numba.extending import overload

from jit.decorator import kernel


def by_type(kernels: Mapping[type, Callable[..., Any]]) -> Callable[..., Any]:
    """A function of a part (a NamedTuple or None) and more that calls the kernel of its type.

    Which one is known when a caller is compiled, so the choice costs nothing at run time, and
    what a kernel returns as a constant is one in its caller.
    """

    def chosen(part: Any, *arguments: Any) -> Any:
        return kernels[type(part)](part, *arguments)

    # As @kernel(inline=True, borrowed=True).
    @overload(chosen, jit_options={"_nrt": False, "forceinline": True})
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
