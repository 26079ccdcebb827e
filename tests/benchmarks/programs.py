"""Helpers that run the programs of benchmarks/ and paper/."""

from collections.abc import Callable
from pathlib import Path

from typer.testing import CliRunner, Result

from benchmarks.program import app_of

ROOT = Path(__file__).resolve().parents[2]


def called(main: Callable[..., None], *words: str) -> Result:
    """Run a program in this process."""
    return CliRunner().invoke(app_of(main), list(words), env={"COLUMNS": "300"})
