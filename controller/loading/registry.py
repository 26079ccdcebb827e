"""Laws by what a scene calls them: `find` is where a reference becomes a loaded law.

A reference is the name of a shipped law, a file (Python, C library or FMU), a module, or an entry
point of an installed package, which names a module.
"""

import difflib
import importlib
import importlib.metadata
import os
import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from pydantic.fields import FieldInfo

from hertzloop.common.missing_files import why_unreadable
from hertzloop.common.text_files import python_text
from hertzloop.controller.loading.identity import SHIPPED, TEXT_DIGITS, text_digest
from hertzloop.controller.loading.interface import check_home
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.library import library_law
from hertzloop.controller.loading.python import file_law, module_law, module_path
from hertzloop.controller.loading.unit import unit_law

_FILES = {".py": file_law, ".so": library_law, ".dylib": library_law, ".fmu": unit_law}
_SOURCE = (".c", ".cc", ".cpp", ".cxx")
ENTRY_POINTS = "hertzloop.laws"
NO_CONTROL = "off"  # the law that stands for none
_FILE = re.compile(r"(?P<file>.+\.(?:py|so|dylib|fmu))(?::(?P<name>\w+))?", re.DOTALL)
_MODULE = re.compile(r"(?P<module>\w+(?:\.\w+)+|\w+(?=:))(?::(?P<name>\w+))?")


@cache
def shipped() -> tuple[str, ...]:
    """Names of the laws that come with hertzloop, one file each."""
    files = (f.stem for f in SHIPPED.glob("*.py"))
    return tuple(sorted(name for name in files if not name.startswith("_")))


def known() -> list[str]:
    """Names of all laws that need no file: shipped and of installed packages."""
    return [*shipped(), *sorted(_entry_points())]


@cache
def _entry_points() -> dict[str, str]:
    return {e.name: e.value for e in importlib.metadata.entry_points(group=ENTRY_POINTS)}


def find(reference: str, digest: str | None = None) -> Law:
    """The law that a reference means. Raises LawError; also if it has not the `digest` given, of
    which nothing is executed then."""
    if reference in shipped():
        law = shipped_law(reference)
        check_digest(reference, law.digest, digest)
        return law
    load: Callable[[str], Law]
    if file := _FILE.fullmatch(reference):
        path = Path.cwd() / file["file"]
        load = partial(_FILES[path.suffix], path, file["name"])
    elif Path(reference).suffix not in _SOURCE and (
        module := _MODULE.fullmatch(_entry_points().get(reference, reference))
    ):
        path = module_path(reference, module["module"])
        load = partial(module_law, reference, module["module"], path, module["name"])
    else:
        raise _unknown(reference)

    def checked() -> Law:
        text = _text_digest(path)
        if digest is not None and text[:TEXT_DIGITS] != digest[:TEXT_DIGITS]:
            check_digest(str(path), text, digest)
        law = load(text)
        check_digest(str(path), law.digest, digest)
        return law

    try:
        return _found(reference, path, digest, checked)
    except OSError as error:
        place = "" if reference == str(path) else f"{path} "
        raise LawError(
            f"controller.law = '{reference}': {place}cannot be read: "
            + why_unreadable(path, error, "'hertzloop law new mine.py' writes a law.")
        ) from error


def _text_digest(path: Path) -> str:
    try:
        return text_digest(path)
    except (SyntaxError, ValueError) as error:
        raise LawError(f"law {path}: is not valid Python: {error}") from error


def _unknown(reference: str) -> LawError:
    if Path(reference).suffix in _SOURCE:
        library = Path(reference).with_suffix(".so")
        return LawError(
            f"controller.law = '{reference}': is source code. Run "
            f"`{compilation(Path(reference))}`, then set controller.law = '{library}'."
        )
    close = difflib.get_close_matches(reference, known(), 1)
    hint = f"Did you mean {close[0]}? " if close else ""
    return LawError(
        f"controller.law = '{reference}': unknown law. {hint}Use one of {', '.join(known())}, "
        "a file such as mine.py, mine.so or mine.fmu, or package.module:Name."
    )


@cache
def shipped_law(name: str) -> Law:
    """A law that comes with hertzloop."""
    path = SHIPPED / f"{name}.py"
    home = importlib.import_module(f"hertzloop.controller.laws.{name}")
    check_home(name, home)
    return Law(name, path, python_text(path.read_bytes()), text_digest(path), home)


@cache
def shipped_keys() -> dict[str, FieldInfo]:
    """Scene keys of all shipped laws."""
    return {
        name: info for law in shipped() for name, info in shipped_law(law).keys.model_fields.items()
    }


@dataclass(frozen=True)
class _Loaded:
    """A law, when its file was written, and at which count of `read_again` it was loaded."""

    law: Law
    stamp: tuple[int, int]
    reading: int


_reading = 0
_loaded: dict[str, _Loaded] = {}  # by reference


def _found(reference: str, path: Path, digest: str | None, load: Callable[[], Law]) -> Law:
    """The law as it was loaded before, where nothing may have changed, or that has the digest."""
    stat = path.stat()
    stamp, kept = (stat.st_mtime_ns, stat.st_size), _loaded.get(reference)
    if (
        kept is None
        or kept.stamp != stamp
        or digest not in (None, kept.law.digest)
        or (digest is None and kept.reading != _reading)
    ):
        kept = _loaded[reference] = _Loaded(load(), stamp, _reading)
    return kept.law


def read_again() -> None:
    """Have the laws of files and modules read anew when they are next asked for: what they read
    themselves, such as a file of gains, may have changed meanwhile."""
    global _reading
    _reading += 1


def load_anew(reference: str) -> Law:
    """The law that a reference means, loaded once more. Raises LawError."""
    read_again()
    return find(reference)


def check_digest(law: str, found: str, wanted: str | None) -> None:
    """Raise LawError, which names the `law`, if another digest than that found is wanted."""
    if wanted is None or wanted == found:
        return
    why = "Copy the same file to both sides."
    if found[:TEXT_DIGITS] == wanted[:TEXT_DIGITS] and len(found) == len(wanted):
        why = (
            "Its files are the same, but other values were read when it was imported: from a file, "
            "the environment, another module, random numbers or a clock. Make these the same on "
            "both sides."
        )
    raise LawError(f"law {law}: its digest here is {found}, but {wanted} is required. {why}")


def resolve(reference: str, folder: Path | None = None) -> str:
    """A reference with the whole path of its file: in `folder`, else in the working folder. Raises
    LawError for a file's name without its ending."""
    if reference in shipped():  # the cases of a sweep ask again and again
        return reference
    match = _FILE.fullmatch(reference)
    tried = [*([folder] if folder else []), Path.cwd()]
    if not match:
        files = [f"{reference}{ending}" for ending in (*_FILES, ".c")]
        there = [file for file in files if any(os.path.isfile(at / file) for at in tried)]
        if there and re.fullmatch(r"\w+", reference) and reference not in known():
            raise LawError(
                f"controller.law = '{reference}': unknown law, but the file {there[0]} exists. "
                f"Give the full file name, controller.law = '{there[0]}'."
            )
        return reference
    found = next((f / match["file"] for f in tried if os.path.isfile(f / match["file"])), None)
    path = (found or tried[-1] / match["file"]).resolve()
    return f"{path}:{match['name']}" if match["name"] else str(path)


def check_one_file(reference: str, folder: Path | None) -> None:
    """Raise LawError if `folder` and the working folder have a file each that a reference means."""
    match = _FILE.fullmatch(reference)
    if not match or folder is None:
        return
    beside, here = folder / match["file"], Path.cwd() / match["file"]
    if beside.is_file() and here.is_file() and not beside.samefile(here):
        raise LawError(
            f"controller.law = '{reference}': means {beside.resolve()}, beside the scene, and "
            f"{here}. Give the whole path of one of them."
        )


def compilation(path: Path) -> str:
    """The command that makes a library beside a law's source text in C."""
    compiler = "cc" if path.suffix == ".c" else "c++"
    source, library = shlex.quote(str(path)), shlex.quote(str(path.with_suffix(".so")))
    return f"{compiler} -O2 -fPIC -shared -ffp-contract=off {source} -o {library} -lm"
