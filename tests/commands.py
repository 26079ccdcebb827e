"""Call a command line within this process."""

from collections.abc import Mapping, Sequence
from typing import Any
from unittest.mock import patch

from typer.testing import CliRunner, Result

from hertzloop.cli import app


def invoke(words: Sequence[str], env: Mapping[str, str] | None = None) -> Result:
    """Call `hertzloop WORDS` and return exit code and output."""
    commands: Any = app.built()
    # The runner makes a command of an application; this one is made.
    with patch("typer.testing._get_command", lambda made: made):
        return CliRunner().invoke(commands, list(words), env=env)
