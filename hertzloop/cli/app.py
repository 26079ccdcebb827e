"""The command line: the table of all commands, and how one of them is loaded.

A command's module is imported when the command is called, so that `hertzloop --help` needs none of
them. The help of an option stands in the section Args of the command's docstring. Exit codes: 0
done, 1 a run failed or recordings differ, 2 the user's mistake, 130 interrupted.
"""

import inspect
import os
import re
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Annotated, Any, cast, get_args, get_origin

import typer
from typer.core import TyperCommand, TyperGroup

from hertzloop.bus import LEAVING

_QUIET = ("--quiet", "-q")


@dataclass(frozen=True)
class Leaf:
    """A command: its words after `hertzloop`, "module:function" below hertzloop.cli, the first
    sentence of its help, and an example of its use."""

    words: str
    function: str
    summary: str
    example: str


MAIN = (
    Leaf(
        "run", "run:run", "Run and record a scene, and compare it with the same run without "
                          "control.",
        "run aluminium-3mm --set controller.latency_us=5",
    ),
    Leaf(
        "replay", "recordings:replay",
        "Watch a recording in slow motion beside the run without control.",
        "replay aluminium-20mm.mcap --save replay.rrd",
    ),
    Leaf(
        "sweep", "sweeps:sweep", "Simulate a scene over ranges of its keys.",
        "sweep aluminium-3mm --over controller.latency_us=0:20:1 --over sensors.bits=8,12,16",
    ),
    Leaf(
        "tune", "tune:tune", "Search for the law and the parameters with the best figures in "
                             "a scene.",
        "tune aluminium-20mm --law slope_threshold --law shifted_threshold --out-dir tuned",
    ),
    Leaf(
        "budget", "budget:budget",
        "Find how much latency and how few bits a law tolerates.",
        "budget aluminium-3mm --law slope_threshold --goal 'plate_energy_db <= -3' --quick",
    ),
    Leaf(
        "margin", "margin:margin", "Tell how stable a linear law's loop is in flight.",
        "margin aluminium-20mm --set controller.law=velocity_feedback --set controller.kappa=0.05",
    ),
    Leaf(
        "fit", "fit:fit", "Fit keys of a scene to measured records.",
        "fit aluminium-3mm drop.csv --free sphere.radius_m --json fit.json",
    ),
    Leaf(
        "report", "recordings:report", "Write an HTML report on a recording, a sweep or a tuning.",
        "report aluminium-20mm.mcap --out-dir pages",
    ),
)  # fmt: skip
RECORDINGS = (
    Leaf(
        "inspect", "recordings:inspect", "Check a recording and print its figures.",
        "inspect aluminium-20mm.mcap --json figures.json",
    ),
    Leaf(
        "compare", "recordings:compare",
        "Compare the bytes or the figures of two recordings.",
        "compare a.mcap b.mcap --figures",
    ),
    Leaf(
        "repair", "recordings:repair", "Recover a complete file from a truncated recording.",
        "repair broken.mcap --out whole.mcap",
    ),
    Leaf(
        "export", "export:export",
        "Write a recording's samples as CSV, Parquet, NPZ, HDF5 or MCAP.",
        "export aluminium-20mm.mcap --out samples.csv --from 0 --to 5",
    ),
    Leaf(
        "listen", "listen:listen", "Write the sound of a run, with and without control, as WAV.",
        "listen aluminium-20mm.mcap --out-dir sounds --slow 10",
    ),
)  # fmt: skip
SCENE = (
    Leaf("scene list", "scene:list_scenes", "List the shipped scenes.", "scene list"),
    Leaf("scene show", "scene:show", "Print a shipped scene as TOML.", "scene show aluminium-3mm"),
    Leaf(
        "scene new", "scene:new", "Write a commented scene that runs without changes.",
        "scene new mine.toml",
    ),
    Leaf(
        "scene keys", "scene:keys", "List the keys of a scene: values, unit, default, meaning.",
        "scene keys latency",
    ),
    Leaf(
        "scene check", "scene:check",
        "List the physical effects that a scene neglects, and the size of each.",
        "scene check aluminium-3mm",
    ),
    Leaf(
        "scene modes", "modes:modes",
        "Write modes as a table that a scene can read: of a plate, or measured ones.",
        "scene modes --from plate.unv --contact 12 --direction z --out modes.csv",
    ),
)  # fmt: skip
LAW = (
    Leaf("law list", "law:list_laws", "List the shipped laws and their keys.", "law list"),
    Leaf(
        "law new", "law:new", "Write a commented law in Python or C that runs without changes.",
        "law new mine.py",
    ),
    Leaf(
        "law replay", "law:replay",
        "Feed a recording's samples to another law and show where the forces differ.",
        "law replay aluminium-20mm.mcap --law shifted_threshold",
    ),
    Leaf(
        "law test", "law:controller_test",
        "Test your own controller program in short runs.",
        "law test --controller 'python my_controller.py {name} {listen} {connect}'",
    ),
)  # fmt: skip
NODE = (
    Leaf(
        "node plant", "node:plant", "Run the plant as a separate process.",
        "node plant aluminium-3mm --listen tcp/10.0.0.1:7450",
    ),
    Leaf(
        "node controller", "node:controller", "Run the controller as a separate process.",
        "node controller --connect tcp/10.0.0.1:7450",
    ),
    Leaf(
        "node recorder", "node:recorder", "Run the recorder as a separate process.",
        "node recorder --out run.mcap --connect tcp/10.0.0.1:7450",
    ),
    Leaf(
        "node watch", "watch:watch", "Show a run in progress without delaying it.",
        "node watch --save live.rrd",
    ),
    Leaf(
        "node keys", "host_keys:keys", "Write certificates for a run on several hosts.",
        "node keys secrets --hosts plant=10.0.0.1,controller=10.0.0.2,recorder=10.0.0.3",
    ),
)  # fmt: skip
OTHER = (
    Leaf(
        "export-plant", "export:export_plant",
        "Write the plant for other programs: an FMU or a C library.",
        "export-plant aluminium-3mm --out plant.fmu",
    ),
    Leaf(
        "bench", "bench:bench", "Measure how fast this computer runs a scene.",
        "bench aluminium-3mm --quick",
    ),
)  # fmt: skip
GROUPS: dict[str, tuple[str, tuple[Leaf, ...]]] = {
    "scene": ("Scenes: list, show, new, keys, check, modes.", SCENE),
    "law": ("Laws: list, new, replay, test.", LAW),
    "node": ("Run each process in its own terminal or on its own host.", NODE),
}
PANELS: dict[str, tuple[Leaf, ...] | dict[str, tuple[str, tuple[Leaf, ...]]]] = {
    "Main": MAIN,
    "Recordings": RECORDINGS,
    "Groups": GROUPS,
    "Other": OTHER,
}


def leaves() -> list[Leaf]:
    """Return all commands, in the order of the help."""
    return [*MAIN, *RECORDINGS, *SCENE, *LAW, *NODE, *OTHER]


@cache
def loaded(leaf: Leaf) -> Any:
    """Import a command's module and make its command."""
    module, _, name = leaf.function.partition(":")
    function = getattr(import_module(f"hertzloop.cli.{module}"), name)
    one = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    about = _with_helps(function)
    one.command(
        leaf.words.split()[-1], help=about, epilog=f"Example: hertzloop {leaf.example}"
    )(function)  # fmt: skip
    return typer.main.get_command(one)


def _with_helps(function: Any) -> str:
    """Give a command's options the help that the section Args of its docstring has; returns the
    docstring without it. What is listed there and not annotated is an option, a bool a switch."""
    about, _, listed = (inspect.getdoc(function) or "").partition("\n\nArgs:\n")
    helps = dict(re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", listed, re.MULTILINE))
    shown = dict(inspect.signature(function, eval_str=True).parameters)
    for name, words in helps.items():
        kind = shown[name].annotation
        option: Any = typer.Option(*[f"--{name.replace('_', '-')}"] * (kind is bool))
        if get_origin(kind) is Annotated:
            kind, option = get_args(kind)
        option.help = " ".join(words.split())
        shown[name] = shown[name].replace(annotation=Annotated[kind, option])
    function.__signature__ = inspect.Signature(list(shown.values()))
    function.__annotations__ = {name: one.annotation for name, one in shown.items()}
    return about


class Commands(TyperGroup):
    """A group whose commands are imported when they are called."""

    children: dict[str, "Leaf | Commands"]
    panels: dict[str, str]  # of the help, by command
    _listing = False  # for a help page: no command needs to be imported

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order of the help."""
        return list(self.children)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, imported unless only a help page lists it."""
        child = self.children.get(cmd_name)
        if isinstance(child, Leaf):
            if not self._listing:
                return loaded(child)
            command: Any = TyperCommand(cmd_name, help=child.summary)
        elif child is not None:
            command = child
        else:
            return None
        command.rich_help_panel = self.panels.get(cmd_name)
        return command

    def _listed(self, show: Callable[..., Any], *args: Any) -> Any:
        self._listing = True
        try:
            return show(*args)
        finally:
            self._listing = False

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help page."""
        self._listed(super().format_help, ctx, formatter)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Return the completions of a word."""
        return cast(list[Any], self._listed(super().shell_complete, ctx, incomplete))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take --quiet wherever it stands."""
        words = args[: args.index("--")] if "--" in args else args
        if any(word in _QUIET for word in words):
            from hertzloop.cli.terminal import be_quiet

            be_quiet()
            args = [word for word in words if word not in _QUIET] + args[len(words) :]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        from hertzloop.cli.terminal import explained

        with explained():
            return super().invoke(ctx)


def _version(asked: bool) -> None:
    if asked:
        from hertzloop import __version__

        print(f"hertzloop {__version__}")
        raise typer.Exit()


def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print errors only; works after a command too.")
    ] = False,
) -> None:
    pass


def _group(summary: str, callback: Callable[..., None] | None = None) -> Commands:
    app = typer.Typer(
        cls=Commands, help=summary, no_args_is_help=True, pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        add_completion=callback is not None,
    )  # fmt: skip
    app.callback()(callback or (lambda: None))
    return cast(Commands, typer.main.get_command(app))


@cache
def built() -> Commands:
    """Return the root of all commands."""
    root = _group("Test an active-control law against an impact at 1 MHz, on a real bus.", _main)
    root.children, root.panels = {}, {}
    for panel, members in PANELS.items():
        if isinstance(members, dict):
            for name, (summary, inner) in members.items():
                group = _group(summary)
                group.name, group.panels = name, {}
                group.children = {leaf.words.split()[-1]: leaf for leaf in inner}
                root.children[name], root.panels[name] = group, panel
        else:
            for leaf in members:
                root.children[leaf.words], root.panels[leaf.words] = leaf, panel
    return root


def load(words: Sequence[str]) -> None:
    """Import what the command of this command line needs, if it calls one."""
    plain = [word for word in words if not word.startswith("-")][:2]
    for leaf in leaves():
        if plain[: len(leaf.words.split())] == leaf.words.split():
            loaded(leaf)


def main(commands: Callable[[], None]) -> None:
    """Run what the command line asks for."""
    try:
        commands()
    except SystemExit as end:
        if any(thread.name == LEAVING for thread in threading.enumerate()):
            # zenoh still calls Python from its threads, which aborts when Python ends in order.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(end.code if isinstance(end.code, int) else 1)
        raise
