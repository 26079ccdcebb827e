"""The exported plant as a shared library: kernels, image and a thin layer in C, linked by `cc`."""

import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hertzloop.interop.image import Image
from hertzloop.interop.objects import plant_object
from jit.object_code import outline

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
