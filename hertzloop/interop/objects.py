"""Object code of a plant's kernels for a processor, compiled once for all plants of one type.

Numba compiles for one processor a process, so that happens in a process of its own.
"""

import hashlib
import os
import pickle
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import llvmlite.binding as ll
from numba import config, float64, intp, typeof

from hertzloop.common.jit.folder import cache_folder, keep

if TYPE_CHECKING:
    from hertzloop.interop.kernels import Unit

HOST = "host"
# Instructions of the levels of x86-64 as a C compiler calls them; LLVM adds what goes without
# saying where these are.
_LEVELS = {
    "x86-64": (),
    "x86-64-v2": ("ssse3", "sse4.1", "sse4.2", "popcnt"),
    "x86-64-v3": ("avx", "avx2", "bmi", "bmi2", "fma"),
    "x86-64-v4": ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
}
_MORE = ("avx512vbmi", "avx512ifma", "avx512vnni", "avx512bitalg", "avx512vpopcntdq", "gfni")


class CompileFault(RuntimeError):
    """The kernels could not be compiled for another program."""

    exit_status = 1


def needed(cpu: str) -> list[str]:
    """Instructions beyond plain x86-64 that code for this processor takes."""
    if cpu == HOST:
        here = ll.get_host_cpu_features()
        known = [name for names in (*_LEVELS.values(), _MORE) for name in names]
        return [name for name in known if here.get(name, False)]
    levels = list(_LEVELS)
    return [name for level in levels[: levels.index(cpu) + 1] for name in _LEVELS[level]]


def _kept(outline: "Unit", cpu: str) -> Path:
    # NUMBA_CPU_NAME and NUMBA_CPU_FEATURES say what Numba takes for the host.
    host = (ll.get_host_cpu_name(), config.CPU_NAME, config.CPU_FEATURES) if cpu == HOST else ()
    what = f"{typeof(outline)}\n{cpu}\n{needed(cpu)}\n{host}"
    return cache_folder() / f"plant-{hashlib.sha256(what.encode()).hexdigest()[:24]}.o"


def is_compiled(outline: "Unit", cpu: str) -> bool:
    """Whether the object code is there from an earlier call."""
    return _kept(outline, cpu).exists()


def plant_object(outline: "Unit", cpu: str) -> bytes:
    """Object code of `release`, `advance` and `balance` of a unit with these types. Raises
    CompileFault."""
    kept = _kept(outline, cpu)
    if kept.exists():
        return kept.read_bytes()
    environment = {**os.environ, "NUMBA_DISABLE_INTEL_SVML": "1"}
    if cpu != HOST:
        environment |= {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": ""}
    done = subprocess.run(
        [sys.executable, "-m", __spec__.name],
        input=pickle.dumps(outline),
        env=environment,
        capture_output=True,
    )
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().splitlines()
        raise CompileFault(f"the kernels did not compile for {cpu}: {last[-1] if last else '?'}")
    keep(kept, done.stdout)
    return done.stdout


def _compile(outline: "Unit") -> bytes:
    # For the process that compiles alone: the program that exports starts 0.1 s earlier.
    from hertzloop.interop import kernels as interop_kernels
    from hertzloop.interop.object_code import assembler, object_code

    assembled = assembler(typeof(outline))
    released, advanced, balanced = (
        interop_kernels.release,
        interop_kernels.advance,
        interop_kernels.balance,
    )

    def release(words: Any, drop_height_m: float, touch_phase: float) -> None:
        released(assembled(words), drop_height_m, touch_phase)

    def advance(words: Any, command: float, steps: int) -> None:
        advanced(assembled(words), command, steps)

    def balance(words: Any) -> None:
        balanced(assembled(words))

    return object_code(
        {
            "hertzloop_kernel_release": (release, (intp, float64, float64)),
            "hertzloop_kernel_advance": (advance, (intp, float64, intp)),
            "hertzloop_kernel_balance": (balance, (intp,)),
        }
    )


if __name__ == "__main__":
    with redirect_stdout(sys.stderr):  # as with NUMBA_DEBUG_CACHE=1
        code = _compile(pickle.load(sys.stdin.buffer))
    sys.stdout.buffer.write(code)
