"""Files that a command writes: checks before the work begins, --json, and new files to edit."""

import json
import math
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from hertzloop.cli.terminal import at_end, fail, out
from hertzloop.common.atomic_files import NotWritten, atomic_write, in_place, write_together
from hertzloop.common.optional_dependencies import need
from hertzloop.common.version import __version__
from hertzloop.scene.setup import Setup

_STDOUT = (Path("-"), Path("/dev/stdout"), Path("/dev/fd/1"))
_JSON_BEGINS = '{\n  "hertzloop": '  # then the version: the first bytes of each file of --json
_PICTURES = (".png", ".pdf", ".svg", ".jpg")
_OF_FILES = (*_PICTURES, ".csv", ".html", ".json", ".mcap", ".parquet", ".toml", ".txt")


def check_output(
    path: Path, overwrite: bool, option: str = "--out", read: Iterable[Path] = ()
) -> None:
    """End the command unless a file can be written, and may be.

    Args:
        path: The file to write.
        overwrite: Whether an existing file may be replaced.
        option: The option that named the file.
        read: Input files of the command, which it never replaces.
    """
    # False, without an error, for a path that check_folder refuses.
    exists = os.path.isfile(path)
    for file in read:
        if exists and os.path.exists(file) and path.samefile(file):
            fail(f"{option} = {path}: is an input of this command. Choose another name.")
    if exists and not overwrite:
        fail(f"{path} exists. Choose another name with {option}, or add --overwrite.")
    check_folder(path)


def check_recording(path: Path, overwrite: bool, read: Iterable[Path] = ()) -> None:
    """End the command unless a recording of this name can be written; see `check_output`."""
    check_output(path, overwrite, read=read)
    if path.suffix != ".mcap":
        fail(f"--out = {path}: a recording must end in .mcap. Change the name.")


def check_picture(path: Path) -> None:
    """End the command for a picture whose name does not say how to draw it.

    Raises:
        ModuleNotFoundError: Matplotlib is not installed.
    """
    if path.suffix not in _PICTURES:
        fail(f"{path}: unknown picture format. Use a name that ends in {', '.join(_PICTURES)}.")
    need("matplotlib")


def _check_reachable(path: Path) -> None:
    """End the command for a path that the system refuses to look at, such as one too long."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror}. Choose another name.")


def check_folder(path: Path | None) -> None:
    """End the command unless the folder of a file, if there is one to write, takes it."""
    if path is None:
        return
    _check_reachable(path)
    if path.is_symlink() and not path.exists():
        fail(
            f"cannot write {path}: links to {os.readlink(path)}, which does not exist. Remove the "
            "link, or choose another name."
        )
    if path.is_dir():
        fail(f"{path}: is a folder. Give the name of a file.")
    if not path.parent.is_dir():
        fail(f"cannot write {path}: the folder {path.parent} does not exist. Create it.")
    try:
        if not in_place(path):
            check_writable(path.resolve().parent)
    except NotWritten as error:
        fail(f"{error}. Choose another name.")


def check_writable(folder: Path) -> None:
    """End the command unless an existing folder takes a new file."""
    try:
        # Tried, since permissions do not tell of read-only and special file systems.
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        fail(f"cannot write to the folder {folder}: {error.strerror}. Choose another.")


def make_folder(folder: Path) -> None:
    """Make a folder for results; end the command unless it takes files."""
    if folder.suffix in _OF_FILES and not folder.is_dir():
        fail(f"{folder}: must be a folder, not a file. Give a name without {folder.suffix}")
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    # Also after an error, such as a full disk: no command leaves a folder without results.
    at_end.append(lambda: _remove_empty(new))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"cannot create the folder {folder}: {error.strerror}")
    check_writable(folder)


def _remove_empty(folders: Iterable[Path]) -> None:
    """Remove folders, the innermost first, that have no files."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:  # it has files, or was not made
            return


def files_of(setup: Setup, *named: str) -> list[Path]:
    """Paths that a scene may be made of, whether or not such files exist.

    Args:
        setup: The scene, whose law can be a file.
        named: Name of the scene, and settings as `key=value`.
    """
    law = setup.scene.controller.law
    texts = [law, law.rpartition(":")[0], *named, *(text.partition("=")[2] for text in named)]
    return [Path(text.strip("\"' ")) for text in texts if text]


def check_json(path: Path | None, *outputs: Path | None) -> None:
    """End the command unless the file of --json, if one is given, can be written.

    It must be new, empty, or an earlier file of --json. If --json writes to standard output, all
    text for people goes to standard error from here on.

    Args:
        path: What --json names.
        outputs: Other files that the command writes.
    """
    if path in _STDOUT:
        out.stderr = True
        return
    check_folder(path)
    if path is None:
        return
    if any(output is not None and output.resolve() == path.resolve() for output in outputs):
        fail(f"--json = {path}: is another output of this command. Choose another name.")
    if not is_replaceable(path, _JSON_BEGINS):
        fail(f"--json = {path}: exists and was not written by --json. Choose another name.")


def is_replaceable(path: Path, beginning: str) -> bool:
    """Return whether a file is missing, empty, or begins as the files do that take its place."""
    if not path.is_file():
        return True
    try:
        with path.open("rb") as file:
            return file.read(len(beginning)) in (b"", beginning.encode())
    except OSError:  # it may be written, but not read
        return False


def write_json(path: Path | None, data: dict[str, Any]) -> None:
    """Write data and the version of hertzloop to the file of --json, if one is given."""
    if path is None:
        return
    text = json.dumps({"hertzloop": __version__, **_without_nan(data)}, indent=2)
    if path in _STDOUT:
        print(text)
        return
    if not is_replaceable(path, _JSON_BEGINS):
        fail(f"--json = {path}: another program wrote this file. It was not changed.", 1)
    atomic_write(path, text + "\n")


def _without_nan(data: Any) -> Any:
    """Return data with None for the numbers that JSON does not have: nan and infinities."""
    if isinstance(data, dict):
        return {key: _without_nan(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_without_nan(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def write_new(
    file: Path, endings: tuple[str, ...], kind: str, texts: Callable[[], dict[Path, str]], then: str
) -> None:
    """Write new files for the user to edit, and print the next command to type.

    It ends the command if the file has another ending, or if one of the files exists.

    Args:
        file: The file that the user named.
        endings: Endings that it may have.
        kind: What it is, for the error.
        texts: Returns the files to write, with their texts.
        then: The next command.
    """
    if file.suffix not in endings:
        fail(f"{file}: a {kind} must end in {' or '.join(endings)}. Change the name.")
    check_folder(file)
    written = texts()
    for path in written:
        if path.exists():
            fail(f"{path} exists. Choose another name.")
    write_together(written)
    out.say(f"written: {', '.join(map(str, written))}. Next: {then}")
