"""Laws as shared libraries; hertzloop_law.h says what they export."""

import ctypes
import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import BaseModel, create_model

from hertzloop.controller.law import Keys, LawContext, LawError
from hertzloop.controller.loading.bound import BoundLaw
from hertzloop.controller.loading.compiled import FUNCTIONS
from hertzloop.controller.loading.law import ABOUT_FIELDS, Law, key_field
from hertzloop.controller.loading.records import PackedRecord

_ABI = 1


class _Description(ctypes.Structure):
    _fields_ = (
        ("abi", ctypes.c_int64),
        ("senses", ctypes.c_char_p),
        ("parameters_bytes", ctypes.c_int64),
        ("state_bytes", ctypes.c_int64),
    )


class _Key(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("unit", ctypes.c_char_p),
        ("description", ctypes.c_char_p),
        ("initial", ctypes.c_double),
        ("least", ctypes.c_double),
        ("most", ctypes.c_double),
    )


@dataclass(frozen=True, eq=False)
class LibraryLaw(Law):
    """A law in a shared library; `home` is the library."""

    @cached_property
    def _description(self) -> _Description:
        return _Description.in_dll(self.home, "hertzloop_law")

    @cached_property
    def _declared(self) -> tuple[str, type[BaseModel]]:
        fields: dict[str, Any] = {}
        table = ctypes.cast(
            ctypes.addressof(_Key.in_dll(self.home, "hertzloop_keys")), ctypes.POINTER(_Key)
        )
        for key in iter(table):
            if not key.name:
                break
            description = f"{(key.description or b'').decode()} ({(key.unit or b'').decode()})"
            low = None if key.least == -math.inf else key.least
            high = None if key.most == math.inf else key.most
            fields[key.name.decode()] = key_field(key.initial, low, high, description)
        senses = (self._description.senses or b"").decode()
        return senses, create_model("Parameters", __base__=Keys, **fields)

    def constants(self, keys: Any, about: LawContext) -> Mapping[str, float]:
        """What is known of the run and the keys, in the order of the record."""
        own = {name: getattr(keys, name) for name in self.keys.model_fields}
        return {name: float(getattr(about, name)) for name in ABOUT_FIELDS} | own

    def bound_to(self, constants: Mapping[str, float], ahead: bool = True) -> BoundLaw:
        """The law with given constants, with all its functions, as they are there."""
        data = np.zeros(self._description.parameters_bytes // 8)
        data[: len(constants)] = list(constants.values())
        prepare = getattr(self.home, "hertzloop_prepare", None)
        if prepare is not None:
            prepare.restype = None
            prepare(ctypes.c_void_p(data.ctypes.data))
        words = np.zeros(self._description.state_bytes // 8, np.int64)
        return BoundLaw(
            self.name,
            {name: _address(self.home, f"hertzloop_{name}") for name in FUNCTIONS},
            PackedRecord(data.dtype, data.view(np.uint8), ()),
            PackedRecord(words.dtype, words, ()),
            self.home,
            [],
        )


_first_digests: dict[Path, str] = {}  # of the libraries that this process has loaded


def _open_library(path: Path, digest: str) -> ctypes.CDLL:
    """Load a library; a copy of it if it has changed since this process first loaded it, because
    the system then returns the old one by its path. Raises OSError."""
    if _first_digests.get(path, digest) != digest:
        with TemporaryDirectory() as folder:
            return ctypes.CDLL(shutil.copy(path, Path(folder) / f"{digest}{path.suffix}"))
    library = ctypes.CDLL(str(path))
    _first_digests[path] = digest
    return library


def library_law(path: Path, name: str | None, digest: str) -> LibraryLaw:
    """The only law in a shared library, as it is now. Raises LawError."""
    try:
        library = _open_library(path, digest)
    except OSError as error:
        raise LawError(f"law {path}: cannot be loaded: {_why(path, error)}") from error
    for name in ("hertzloop_law", "hertzloop_keys", "hertzloop_command"):
        if not _address(library, name):
            raise LawError(
                f"{path}: is not a law; the symbol {name} is missing. See hertzloop_law.h."
            )
    about = _Description.in_dll(library, "hertzloop_law")
    if about.abi != _ABI:
        raise LawError(
            f"{path}: built for version {about.abi} of hertzloop_law.h. Rebuild it for {_ABI}."
        )
    law = LibraryLaw(path.name, path, "", digest, library)
    least = 8 * (len(ABOUT_FIELDS) + len(law.key_names))
    if about.parameters_bytes < least or about.parameters_bytes % 8:
        raise LawError(
            f"{path} has {about.parameters_bytes} bytes of parameters; what is known of a run and "
            f"its keys need {least}, or more in steps of 8"
        )
    if about.state_bytes < 16 or about.state_bytes % 8:
        raise LawError(
            f"{path}: state of {about.state_bytes} bytes. Use 16, 24 or a larger multiple of 8."
        )
    return law


def _address(library: Any, name: str) -> int:
    """Address of what a library exports, 0 without."""
    try:
        return ctypes.addressof(ctypes.c_char.in_dll(library, name))
    except ValueError:
        return 0


def _why(path: Path, error: OSError) -> str:
    head = path.read_bytes()[:20]
    if head[:4] != b"\x7fELF":
        return "it is no shared library of this system"
    ours = Path("/proc/self/exe").read_bytes()[:20]
    if head[4:6] != ours[4:6] or head[18:20] != ours[18:20]:
        return "it was built for another processor architecture than this one"
    return str(error).removeprefix(f"{path}: ")
