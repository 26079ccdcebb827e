"""Kernels that come with a wheel, compiled for processors of the level x86-64-v3.

Their arithmetic is strict, so they have the bits of kernels that are compiled here. They serve
where Python, Numba and the sources are those of the wheel, and the processor has that level.
Elsewhere, and in a clone, kernels are compiled when they are first called.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from llvmlite import binding
from numba import config
from numba.core.caching import UserProvidedCacheLocator

LEVEL = "x86-64-v3"
_FEATURES_OF_LEVEL = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
_PACKAGE = Path(__file__).absolute().parents[2]
SHIPPED = _PACKAGE / "compiled_kernels"
_MARKERS = ".compiled-*"  # say for what all kernels are there: see hertzloop.warmup


def unpack(digest: str, folder: Path) -> None:
    """Copy the kernels shipped for a digest of the sources into a folder of kernels, and compile
    for their level from now on; nothing where there are none, or where they do not serve."""
    shipped = SHIPPED / digest
    if not shipped.is_dir() or not _serves():
        return
    config.CPU_NAME, config.CPU_FEATURES = LEVEL, ""
    markers = [folder / marker.name for marker in shipped.glob(_MARKERS)]
    if all(marker.exists() for marker in markers):  # copied by an earlier process
        return
    with suppress(OSError):  # the disk does not take them: they are compiled
        for name, place in _places(folder):
            if (shipped / name).is_dir():
                _copy(shipped / name, place)
        for marker in markers:
            marker.touch()


def pack(digest: str, folder: Path, into: Path) -> None:
    """Copy a folder of kernels to where a wheel ships them, below `into`, the unpacked package."""
    target = into / SHIPPED.name / digest
    for name, place in _places(folder):
        if place.is_dir():
            shutil.copytree(place, target / name)
    for marker in folder.glob(_MARKERS):
        shutil.copy(marker, target)


def _serves() -> bool:
    """Whether the processor has the level of shipped kernels, and the user asks for no other."""
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return (config.CPU_NAME, config.CPU_FEATURES) == (LEVEL, "")
    found = binding.get_host_cpu_features()
    return all(found.get(name) for name in _FEATURES_OF_LEVEL)


def _places(folder: Path) -> Iterator[tuple[str, Path]]:
    """Names of folders in the wheel, and where they lie in a folder of kernels."""
    yield "laws", folder / "laws"  # the modules between C and a law: see `controller.loading`
    yield "laws_compiled", _kept(folder, folder / "laws")
    for path, _, _ in os.walk(_PACKAGE, followlinks=True):  # folders of a clone are links
        name = ".".join(Path(path).relative_to(_PACKAGE.parent).parts)
        yield name, _kept(folder, Path(path))


def _kept(folder: Path, sources: Path) -> Path:
    """Where Numba keeps the kernels of a folder of sources: its name and a digest of its path."""
    file = str(sources / "kernels.py")
    return folder / UserProvidedCacheLocator.get_suitable_cache_subpath(file)


def _copy(source: Path, target: Path) -> None:
    """Copy a folder as a whole, unless it is there. Raises OSError."""
    if target.exists():
        return
    with tempfile.TemporaryDirectory(dir=target.parent) as part:
        whole = shutil.copytree(source, Path(part) / "whole")
        with suppress(OSError):  # another process was first
            os.rename(whole, target)
