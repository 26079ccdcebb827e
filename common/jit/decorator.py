"""The one decorator of compiled functions."""

from collections.abc import Callable
from functools import partial
from typing import Any

from numba import config, njit

from hertzloop.common.jit.folder import cache_folder, has_room, kept_in


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    inline: bool = False,
    part: bool = False,
    copied: bool = False,
    allocates: bool = False,
    checked: bool = False,
) -> Any:
    """Compile a function on its first call, as `@kernel` or `@kernel(...)`.

    Arithmetic is strict: no order of a sum and no rounding is left to the compiler, so the bits are
    the same on every processor. A kernel divides as NumPy does: by zero gives infinity or NaN. It
    releases the interpreter lock. Those of hertzloop are kept on disk, in a folder named by a
    digest of their sources and of Numba's settings. With NUMBA_DISABLE_JIT=1 the function stays
    plain Python.

    Args:
        function: a function of numbers, arrays and NamedTuples of these.
        inline: becomes part of its callers, which call it once a step or oftener.
        part: the same, without an entry for Python, whose making takes long where arguments are
            large. A call from Python ends the process.
        copied: its source is copied into its callers. For what one kernel alone calls, and for what
            does little but call a large kernel, which would be compiled for it once more.
        allocates: it makes arrays, or returns one that it was given or a part of it. All others
            borrow the arrays of their caller without counting references, which takes 0.3 to 0.5 us
            a step.
        checked: an index beyond the end of an array raises IndexError.
    """
    if function is None:
        return partial(
            kernel,
            inline=inline,
            part=part,
            copied=copied,
            allocates=allocates,
            checked=checked,
        )
    if config.DISABLE_JIT:
        return function
    # Numba does not see that what a user's function takes from elsewhere has changed.
    ours = (function.__module__ or "").startswith(("hertzloop.", "benchmarks."))
    options: dict[str, Any] = {
        "error_model": "numpy",
        "nogil": True,
        "cache": ours and not part and has_room(),
        "no_cfunc_wrapper": True,
        "_nrt": allocates,
        "boundscheck": checked,
    }
    if inline or part:
        options["forceinline"] = True
    if part:
        options["no_cpython_wrapper"] = True
    if copied:
        options["inline"] = "always"
    with kept_in(cache_folder()):
        return njit(**options)(function)
