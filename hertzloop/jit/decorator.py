"""The one spelling of a compiled function."""

import os
from collections.abc import Callable
from functools import partial
from typing import Any

from numba import config, njit

from hertzloop.jit.cache import cache_folder, kept_in, stored
from hertzloop.jit.dispatcher import Kernel


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    inline: bool = False,
    borrowed: bool = False,
    fused: bool = False,
    reordered: bool = False,
    kept: bool = True,
    released: bool = False,
    spliced: bool = False,
    bare: bool = False,
) -> Any:
    """Compile a function on its first call, as `@kernel` or `@kernel(...)`; kept on disk.

    Every kernel divides as NumPy does: by zero gives infinity or NaN and no branch that
    raises. NUMBA_DISABLE_JIT=1 leaves the function as it is, plain Python.

    inline: becomes part of its callers, which call it once a step or oftener.
    borrowed: arrays are the caller's and nothing is allocated, so references are not counted
        (Numba's `_nrt=False`); counting those of model and state took 0.15 us a step.
    fused: a product and the sum it goes into may be rounded once instead of twice.
    reordered: terms of a sum may be added in another order, which is what vector lanes need.
        That is chosen when a kernel is compiled: the same bits for every caller on one kind
        of processor.
    released: other threads of Python run meanwhile.
    kept: False for what is kept as a part of its caller only.
    spliced: the text becomes part of its callers' before these are compiled, which it itself then
        never is: much faster, for what is compiled while somebody waits. Not if it calls itself.
    bare: compiled functions alone call it, so that no entry for Python is compiled; as `spliced`.
    """
    if function is None:
        return partial(
            kernel, inline=inline, borrowed=borrowed, fused=fused, reordered=reordered, kept=kept,
            released=released, spliced=spliced, bare=bare,
        )  # fmt: skip
    if config.DISABLE_JIT:
        return function
    options: dict[str, Any] = {"no_cfunc_wrapper": True}
    if inline:
        options["forceinline"] = True
    if borrowed:
        options["_nrt"] = False
    if released:
        options["nogil"] = True
    if spliced:
        options["inline"] = "always"
    if bare:
        options["no_cpython_wrapper"] = True
    if fused or reordered:
        freedoms = {"contract": fused, "reassoc": reordered}
        options["fastmath"] = {name for name, given in freedoms.items() if given}
    on_disk = kept and os.path.exists(function.__code__.co_filename)  # not typed at a prompt
    ours = (function.__module__ or "").startswith("hertzloop.")
    with kept_in(cache_folder()):
        made = Kernel.of(njit(error_model="numpy", **options)(function))
        if on_disk:
            made._cache = stored(function, quick=ours)
    return made
