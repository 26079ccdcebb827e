"""Where words for people go, and how a command gives up."""

from typing import NoReturn

import typer
from rich.console import Console
from rich.markup import escape

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def fail(sentence: str, code: int) -> NoReturn:
    """Say what is wrong and end the command with an exit code."""
    err.print(f"[red]error:[/red] {escape(sentence)}", soft_wrap=True, markup=True)
    raise typer.Exit(code)
