"""The exported plant as a shared library: kernels, image and a thin layer in C, linked by `cc`."""

import hashlib
import os
import pickle
import secrets
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from hertzloop.interop.image import Image
from jit.cache import cache_folder
from jit.object_code import outline

if TYPE_CHECKING:
    from hertzloop.interop.kernels import Unit

C = Path(__file__).resolve().parent / "c"
HEADER, EXAMPLE, LICENCES = C / "hertzloop_plant.h", C / "main.c", C / "licences.txt"
_SOURCES = ("plant.c", "noise.c")
_NORMAL = Path(np.__file__).parent / "random" / "lib" / "libnpyrandom.a"  # NumPy's, in C
# Rounding as written: a product and a sum stay two operations.
_FLAGS = ("-std=gnu11", "-O2", "-fPIC", "-ffp-contract=off", "-fvisibility=hidden", "-Wall")
_LINK = ("-shared", "-s", "-Wl,--gc-sections", "-Wl,--exclude-libs,ALL", "-Wl,-z,defs")


class NoCompiler(RuntimeError):
    """There is no C compiler, or it refused."""


def write_library(
    image: Image, cpu: str, out: Path, more: tuple[Path, ...] = (), headers: Path = C
) -> None:
    """Write the shared library of a plant, with `more` sources in C that use it, and `headers` of
    theirs. Raises NoCompiler, and CompileFault of `objects`."""
    if shutil.which("cc") is None:
        raise NoCompiler("there is no C compiler `cc` here; on Debian `apt install gcc libc6-dev`")
    if not _NORMAL.exists():
        raise NoCompiler(f"this NumPy comes without {_NORMAL.name}; install it by pip")
    kernels = plant_object(outline(image.unit), cpu)
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "image.bin").write_bytes(image.data)
        (folder / "image.h").write_text(image.header(cpu), encoding="utf-8")
        (folder / "kernels.o").write_bytes(kernels)
        sources = [C / source for source in _SOURCES] + list(more)
        done = subprocess.run(
            ["cc", *_FLAGS, "-I", folder, "-I", C, "-I", headers, *_LINK, "-o", "made.so",
             *sources, "kernels.o", _NORMAL, "-lm"],
            cwd=folder, capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode != 0:
            said = next(iter(done.stderr.strip().splitlines()), "no reason given")
            raise NoCompiler(f"cc did not make the library: {said}")
        shutil.copyfile(folder / "made.so", out)


def write_folder(image: Image, cpu: str, folder: Path) -> None:
    """Write library, header, example and licences into an existing folder. Raises as
    `write_library`."""
    write_library(image, cpu, folder / "libhertzloop_plant.so")
    for source in (HEADER, EXAMPLE, LICENCES):
        shutil.copyfile(source, folder / source.name)


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


def needed(cpu: str) -> list[str]:
    """Instructions beyond plain x86-64 that code for this processor takes."""
    if cpu == HOST:
        import llvmlite.binding as ll

        here = ll.get_host_cpu_features()
        known = [name for names in (*_LEVELS.values(), _MORE) for name in names]
        return [name for name in known if here.get(name, False)]
    levels = list(_LEVELS)
    return [name for level in levels[: levels.index(cpu) + 1] for name in _LEVELS[level]]


def _kept(outline: "Unit", cpu: str) -> Path:
    from numba import typeof

    what = f"{typeof(outline)}\n{cpu}\n{needed(cpu)}"
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
    made = kept.with_suffix(f".{secrets.token_hex(8)}")
    done = subprocess.run(
        [sys.executable, "-m", __spec__.name, made],
        input=pickle.dumps(outline), env=environment, capture_output=True,
    )  # fmt: skip
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().splitlines()
        raise CompileFault(f"the kernels did not compile for {cpu}: {last[-1] if last else '?'}")
    made.replace(kept)
    return kept.read_bytes()


def _compile(outline: "Unit") -> bytes:
    from numba import float64, intp, typeof

    from hertzloop.interop import kernels as k
    from jit.object_code import assembler, object_code

    assembled = assembler(typeof(outline))
    released, advanced, balanced = k.release, k.advance, k.balance

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
    Path(sys.argv[1]).write_bytes(_compile(pickle.load(sys.stdin.buffer)))
