"""Options and checks that commands share."""

import inspect
import json
import math
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import is_dataclass
from functools import cache, wraps
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer

from hertzloop.cli.terminal import err, fail, out, progress
from hertzloop.common.atomic_files import NotWritten, in_place, write_together, write_whole
from hertzloop.common.optional_dependencies import need
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.loop.run_options import LOCK_STEP, RunOptions, options_and_flags, options_of
from hertzloop.processes.law_trial import try_law
from hertzloop.processes.signals import INTERRUPTED, ending_signals
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.loading import load as load_scene
from hertzloop.scene.plate_model import WARN_ABOVE_S, build_time_s
from hertzloop.scene.setup import Setup, resolve
from hertzloop.warmup import all_compiled, anything_compiled, ensure_compiled

SceneArgument = Annotated[str, typer.Argument(help="Name of a shipped scene, or a .toml file.")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", help="Change a scene key, for example sensors.bits=12.")
]
SeedOption = Annotated[
    int | None, typer.Option(help="Set the random seed; default: run.seed of the scene.")
]
DetailsOption = Annotated[
    bool, typer.Option("--details", help="Print all tables, figures and warnings.")
]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")]
JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        help="Write all figures as JSON to this file and replace it; -: standard output.",
    ),
]

_STDOUT = (Path("-"), Path("/dev/stdout"), Path("/dev/fd/1"))
_JSON_BEGINS = '{\n  "hertzloop": '  # and its version: what --json wrote

TransportName = Literal["zenoh", "inprocess", "compiled"]

LARGEST_PORT = 65535
_PICTURES = (".png", ".pdf", ".svg", ".jpg")
_OF_FILES = (*_PICTURES, ".csv", ".html", ".json", ".mcap", ".parquet", ".toml", ".txt")


def takes(
    role: str = "", only: Sequence[str] = (), **defaults: Any
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of dataclasses: in place of a parameter of such a class it has an
    option for every field that is one, or for those of a `role`, or `only` for some; `defaults` by
    field."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        shown: list[inspect.Parameter] = []
        made: dict[str, tuple[type, list[str]]] = {}
        for one in inspect.signature(command, eval_str=True).parameters.values():
            if not is_dataclass(one.annotation):
                shown.append(one.replace(kind=one.KEYWORD_ONLY))
                continue
            kind: Any = one.annotation
            found, types = options_and_flags(kind, role), get_type_hints(kind)
            found = [(field, flag) for field, flag in found if field.name in only or not only]
            made[one.name] = kind, [field.name for field, _ in found]
            for field, flag in found:
                kind, about = types[field.name], field.metadata
                if get_origin(kind) is Sequence:
                    kind = list[get_args(kind)[0]]  # type: ignore[misc]
                typed = Annotated[kind, typer.Option(flag, help=about["help"], **about["typer"])]
                default = defaults.get(field.name, field.default)
                shown.append(
                    inspect.Parameter(
                        field.name, one.KEYWORD_ONLY, default=default, annotation=typed
                    )
                )

        @wraps(command)
        def called(**given: Any) -> None:
            for name, (kind, names) in made.items():
                given[name] = kind(**{field: given.pop(field) for field in names})
            command(**given)

        called.__annotations__ = {one.name: one.annotation for one in shown}
        vars(called)["__signature__"] = inspect.Signature(shown)
        return called

    return decorated


def scene_from(
    source: str, settings: list[str] | None, seed: int | None, tried: bool = False
) -> Setup:
    """Return the resolved scene; end the command if it cannot be simulated. `tried`: whether the
    caller has already tried the law."""
    setup = resolve(load_scene(source, settings or (), seed))

    if not anything_compiled():
        announce_compilation()
    takes_s, spec = build_time_s(setup.plant), setup.plant
    if takes_s >= WARN_ABOVE_S:
        count = spec.plate.modes_below(spec.frequency_limit_hz)
        err.say(f"Computing about {count:.2g} modes takes about {takes_s:.0f} s of processor time.")
    if not tried:
        check_law(setup)
    return setup


def given_that_need(options: Any, what: str) -> Iterator[str]:
    """Names of the options that have a value and need something."""
    for one in options_of(options):
        if what in one.metadata["needs"] and getattr(options, one.name):
            yield one.name


def check_pace(setup: Setup, options: RunOptions) -> None:
    """End the command for a pace that cannot be, or beside options that need the lock-step."""
    if options.pace is None:
        return
    for name in given_that_need(options, LOCK_STEP):
        fail(
            f"--{name}: cannot be combined with --pace, which does not wait for forces. "
            f"Remove one of the two."
        )
    from hertzloop.loop.paced import check_pace as check  # 0.05 s of what records nothing

    check(setup, options.pace, options.timeout_s)


def check_law(setup: Setup) -> None:
    """Print what a law says of its keys; try one that is not shipped for a moment, and say so if it
    is slow. Raises SceneError."""
    if setup.law_reference in shipped_laws():
        if said := loaded_law(setup).note(setup.scene.controller.keys):
            err.say(said)
        return

    note = try_law(setup)
    if note:
        err.say(note)


def check_reachable(path: Path) -> None:
    """End the command for a path that cannot even be looked at, such as one too long."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror}")


def check_picture(path: Path) -> None:
    """End the command for a picture whose name does not say how to draw it.

    Raises ModuleNotFoundError where there is nothing to draw it with.
    """
    if path.suffix not in _PICTURES:
        fail(f"{path}: unknown picture format. Use a name that ends in {', '.join(_PICTURES)}.")
    need("matplotlib")


def check_output(
    path: Path, overwrite: bool, option: str = "--out", read: Iterable[Path] = ()
) -> None:
    """End the command unless `path` can be written, and may be; it is none of the files that the
    command has to `read`."""
    check_reachable(path)
    for file in read:
        if path.is_file() and os.path.exists(file) and path.samefile(file):
            fail(f"{option} = {path}: is an input of this command. Choose another name.")
    if path.exists() and not path.is_file() and not overwrite:
        fail(f"cannot write {path}: not a regular file. Choose another name.")
    if path.is_file() and not overwrite:
        fail(f"{path} exists. Choose another name with {option}, or add --overwrite.")
    check_folder(path)


def check_recording(path: Path, overwrite: bool, read: Iterable[Path] = ()) -> None:
    """End the command unless `path` is the name of a recording that can be written."""
    check_output(path, overwrite, read=read)
    if path.suffix != ".mcap":
        fail(f"--out = {path}: a recording must end in .mcap. Change the name.")


def files_of(setup: Setup, *named: str) -> list[Path]:
    """What may be files that a scene was made of: its law's, and what is `named`, as the scene or
    in a setting."""
    law = setup.law_reference
    texts = [law, law.rpartition(":")[0], *named, *(text.partition("=")[2] for text in named)]
    return [Path(text.strip("\"' ")) for text in texts if text]


def check_folder(path: Path | None) -> None:
    """End the command unless a file to write, if there is one, can be."""
    if path is None:
        return
    check_reachable(path)
    if path.is_dir():
        fail(f"{path}: is a folder. Give the name of a file.")
    if path.is_symlink() and not path.exists():
        fail(
            f"cannot write {path}: links to {os.readlink(path)}, which does not exist. Remove the "
            "link, or choose another name."
        )
    if not path.parent.is_dir():
        fail(f"cannot write {path}: the folder {path.parent} does not exist. Create it.")
    try:
        if not in_place(path):
            check_writable(path.resolve().parent if path.is_symlink() else path.parent)
    except NotWritten as error:
        fail(f"{error}. Choose another name.")


def check_json(path: Path | None, *outputs: Path | None) -> None:
    """End the command unless what --json asks for, if it does, can be written: to a file that is
    new, empty or an earlier one of these, and none of the command's other `outputs`. Where it goes
    to standard output, nothing else does: words for people then go to standard error."""
    if path in _STDOUT:
        out.stderr = True
        return
    check_folder(path)
    if path is None:
        return
    if any(output is not None and output.resolve() == path.resolve() for output in outputs):
        fail(f"--json = {path}: is another output of this command. Choose another name.")
    if not _of_json(path):
        fail(f"--json = {path}: exists and was not written by --json. Choose another name.")


def _of_json(path: Path) -> bool:
    """Whether nothing is lost if a file is replaced."""
    if not path.is_file():
        return True
    try:
        with path.open("rb") as file:
            return file.read(len(_JSON_BEGINS)) in (b"", _JSON_BEGINS.encode())
    except OSError:  # it may be written, but not read
        return False


def check_writable(folder: Path) -> None:
    """End the command unless a file can be made in an existing folder."""
    try:
        # Tried, since permissions do not tell of read-only and special file systems.
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        fail(f"cannot write to the folder {folder}: {error.strerror}")


def make_folder(folder: Path) -> None:
    """Make a folder for results; end the command unless files can be written into it, and for the
    name of a file."""
    if folder.suffix in _OF_FILES and not folder.is_dir():
        fail(f"{folder}: must be a folder, not a file. Give a name without {folder.suffix}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"cannot create the folder {folder}: {error.strerror}")
    check_writable(folder)


def end_if_not_run(reasons: list[str], total: int) -> None:
    """End a command of many cases with exit code 1 if some could not be run; `reasons`: of each."""
    if not reasons:
        return
    counted = Counter(reasons).most_common()
    for reason, times in counted[:3]:
        err.say(f"{times} times: {reason}" if times > 1 else reason)
    if len(counted) > 3:
        err.print(f"... and {len(counted) - 3} more reasons")
    fail(f"{len(reasons)} of {total} cases failed", 1)


def write_json(path: Path | None, data: dict[str, Any]) -> None:
    """Write what --json asks for, if it does: `data` and the version of hertzloop."""
    if path is None:
        return
    marked = {"hertzloop": version("hertzloop"), **_strict(data)}
    if path in _STDOUT:
        print(json.dumps(marked, indent=2))
        return
    if not _of_json(path):
        fail(f"--json = {path}: another program wrote this file. It was not changed.", 1)
    write_whole(path, json.dumps(marked, indent=2) + "\n")


def _strict(data: Any) -> Any:
    """The same with null for numbers that JSON does not know."""
    if isinstance(data, dict):
        return {key: _strict(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_strict(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def compile_first(*scenes: Setup, paced: bool = False) -> None:
    """Compile what scenes run, see `ensure_compiled`; ends the command if one cannot be built."""
    if all_compiled(*scenes, paced=paced):
        return
    announce_compilation()

    def end(_: int) -> None:
        # At once, since nothing is to be kept: what LLVM calls loses a KeyboardInterrupt.
        err.show_cursor()
        err.say("interrupted")
        os._exit(INTERRUPTED)

    with progress("Compiling", 100, lines=True) as advance, ending_signals(end):
        ensure_compiled(
            *scenes,
            paced=paced,
            on_progress=lambda share, what: advance(round(100 * share), f"Compiling {what}"),
        )


@cache
def announce_compilation() -> None:
    """Say why the next seconds are silent; once, whatever is compiled after it."""
    err.print("Compiling the model: about 15 s, once for this version of hertzloop.")


def write_new(
    file: Path, endings: tuple[str, ...], kind: str, texts: Callable[[], dict[Path, str]], then: str
) -> None:
    """Write the files of a fresh start, and say what to type next; ends the command if the file has
    another ending or exists.

    Args:
        file: The file that the user named.
        endings: Endings that it may have.
        kind: What it is, for the error.
        texts: Gives all files to write, with their texts.
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
