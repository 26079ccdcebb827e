"""The command line: how a command of the table in `commands` is loaded and called.

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
from functools import cache
from importlib import import_module
from typing import Annotated, Any, cast, get_args, get_origin

import typer
from typer.core import TyperCommand, TyperGroup

from hertzloop.bus import LEAVING
from hertzloop.cli.commands import PANELS, Leaf, leaves

_QUIET = ("--quiet", "-q")


@cache
def loaded(leaf: Leaf) -> Any:
    """Import a command's module and make its command."""
    module, _, name = leaf.function.partition(":")
    if not module.startswith("hertzloop."):
        module = f"hertzloop.cli.{module}"
    function = getattr(import_module(module), name)
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
