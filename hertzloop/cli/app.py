"""The command line: commands are made of the table in `commands`, and loaded when they are called.

Exit codes: 0 done, 1 a run failed or recordings differ, 2 the user's mistake, 130 interrupted.
"""

import os
import sys
import threading
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from hertzloop.bus import LEAVING
from hertzloop.cli.commands import PANELS, CommandEntry, GroupEntry, all_commands

_QUIET = ("--quiet", "-q")
# Of the root and of each command: a command keeps the option of the first context that asks for it.
_HELP = {"help_option_names": ["-h", "--help"]}


@cache
def load_command(entry: CommandEntry) -> Any:
    """Import the module of a command, and return the command with its options."""
    module, _, name = entry.function.partition(":")
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    example = f"Example: hertzloop {entry.example}"
    register = app.command(entry.name, epilog=example, context_settings=_HELP)
    register(getattr(import_module(module), name))
    return typer.main.get_command(app)


class DeferredCommand(TyperCommand):
    """A command for lists, with name and summary; its module is imported when it is called."""

    def __init__(self, entry: CommandEntry, panel: str | None) -> None:
        super().__init__(entry.name, help=entry.summary, rich_help_panel=panel)
        self._entry = entry

    def make_context(self, *args: Any, **extra: Any) -> Any:
        """Return the context of the command that was loaded, which then runs in place of this."""
        return load_command(self._entry).make_context(*args, **extra)


class RootGroup(TyperGroup):
    """The command `hertzloop`: accepts --quiet anywhere, and ends each command with a sentence."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take --quiet out of the words, also where it follows a command."""
        end = args.index("--") if "--" in args else len(args)
        words = [word for word in args[:end] if word not in _QUIET]
        from hertzloop.cli.terminal import set_quiet

        set_quiet(len(words) < end)
        return super().parse_args(ctx, words + args[end:])

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        from hertzloop.cli.terminal import explained

        with explained():
            return super().invoke(ctx)


def _print_version(asked: bool) -> None:
    if asked:
        from hertzloop.common.version import __version__

        print(f"hertzloop {__version__}")
        raise typer.Exit()


def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print errors only; works after a command too.")
    ] = False,
) -> None:
    """Test an active-control law against an impact at 1 MHz, on a real bus."""


def _group_command(group: GroupEntry, panel: str) -> Any:
    """Return a group with its commands, which are not imported yet."""
    app = typer.Typer(
        name=group.name,
        help=group.summary,
        no_args_is_help=True,
        suggest_commands=False,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    app.callback()(lambda: None)
    command: Any = typer.main.get_command(app)
    command.rich_help_panel = panel
    for entry in group.commands:
        command.add_command(DeferredCommand(entry, panel=None))
    return command


@cache
def root_command() -> Any:
    """Return the command `hertzloop` with all groups and commands, none of them imported."""
    app = typer.Typer(
        cls=RootGroup,
        no_args_is_help=True,
        suggest_commands=False,
        context_settings=_HELP,
        pretty_exceptions_enable=False,
    )
    app.callback()(_root)
    root: Any = typer.main.get_command(app)
    for panel, members in PANELS.items():
        for member in members:
            if isinstance(member, GroupEntry):
                root.add_command(_group_command(member, panel))
            else:
                root.add_command(DeferredCommand(member, panel))
    return root


def import_called(words: Sequence[str]) -> None:
    """Import the module of the command that these words call, if they call one."""
    called = [word for word in words if not word.startswith("-")][:2]
    for entry in all_commands():
        own = entry.words.split()
        if called[: len(own)] == own:
            load_command(entry)


def main(command: Callable[[], None]) -> None:
    """Run a command on the words of `sys.argv`, and end the process."""
    try:
        command()
    except SystemExit as end:
        if any(thread.name == LEAVING for thread in threading.enumerate()):
            # zenoh still calls Python from its threads, which aborts when Python ends in order.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(end.code if isinstance(end.code, int) else 1)
        raise
