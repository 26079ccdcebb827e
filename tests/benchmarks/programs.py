"""Helpers that run the programs of benchmarks/ and paper/ as a user does."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
from typer.testing import CliRunner, Result

from benchmarks.program import app_of

ROOT = Path(__file__).resolve().parents[2]


def program(name: str, *words: str, timeout_s: float = 280.0) -> subprocess.CompletedProcess:
    """Run a program from the clone, as a process of its own, to its end."""
    return subprocess.run(
        [sys.executable, "-m", name, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=timeout_s,
    )


def called(main: Callable[..., None], *words: str) -> Result:
    """Run a program in this process."""
    return CliRunner().invoke(app_of(main), list(words), env={"COLUMNS": "300"})


def said(result: Result) -> str:
    """All that a program in this process wrote, in one line and without styles."""
    return " ".join(click.unstyle(result.output).split())
