"""The one decorator of compiled functions."""

from collections.abc import Callable, Collection
from functools import partial
from typing import Any

from numba import config, njit

from hertzloop.common.jit.dispatcher import Kernel
from hertzloop.common.jit.folder import cache_folder
from hertzloop.common.jit.storage import kept_in, stored


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    inline: bool = False,
    fastmath: Collection[str] = (),
    allocates: bool = False,
) -> Any:
    """Compile a function on its first call, as `@kernel` or `@kernel(...)`.

    A kernel divides as NumPy does: by zero gives infinity or NaN. It releases the interpreter lock.
    Those of hertzloop are kept on disk, in a folder named by a digest of their sources and of
    Numba's settings. With NUMBA_DISABLE_JIT=1 the function stays plain Python.

    Args:
        function: a function of numbers, arrays and NamedTuples of these.
        inline: becomes part of its callers, which call it once a step or oftener.
        fastmath: Numba's name for freedoms of rounding. "contract": a product and the sum that it
            goes into may be rounded once. "reassoc": terms of a sum may be added in another order,
            which vector instructions need. Both are settled when the kernel is compiled: the same
            bits for every caller on one kind of processor.
        allocates: it makes arrays, or returns one that it was given or a part of it. All others
            borrow the arrays of their caller without counting references, which takes 0.15 us a
            step.
    """
    if function is None:
        return partial(kernel, inline=inline, fastmath=fastmath, allocates=allocates)
    if config.DISABLE_JIT:
        return function
    options: dict[str, Any] = {
        "error_model": "numpy",
        "nogil": True,
        "no_cfunc_wrapper": True,
        "_nrt": allocates,
    }
    if inline:
        options["forceinline"] = True
    if fastmath:
        options["fastmath"] = set(fastmath)
    with kept_in(cache_folder()):
        made = Kernel.of(njit(**options)(function))
        if (function.__module__ or "").startswith(("hertzloop.", "benchmarks.")):
            made._cache = stored(function)
    return made
