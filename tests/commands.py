"""Call a command line within this process."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from unittest.mock import patch

from typer.testing import CliRunner, Result

from hertzloop.cli import app, terminal  # noqa: F401 - its consoles keep the COLUMNS of now


def invoke(words: Sequence[str], env: Mapping[str, str] | None = None) -> Result:
    """Call `hertzloop WORDS` and return exit code and output."""
    commands: Any = app.root_command()
    # The runner makes a command of an application; this one is made.
    with patch("typer.testing._get_command", lambda made: made):
        return CliRunner().invoke(commands, list(words), env=env)


def call(*words: object) -> Result:
    """Call `hertzloop WORDS` on a wide terminal. Fails where an exception passes the command."""
    result = invoke([str(word) for word in words], env={"COLUMNS": "300"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def said(result: Result) -> str:
    """What was printed, without line breaks and frames."""
    return " ".join(result.output.replace("│", " ").split())


def succeed(*words: object) -> str:
    """What a command that succeeds says, in one line."""
    result = call(*words)
    assert result.exit_code == 0, result.output
    return said(result)


def refused(sentence: str, *words: object, code: int = 2) -> str:
    """What a command says that ends with this sentence and exit code, by default as the user's
    mistake."""
    result = call(*words)
    assert result.exit_code == code, result.output
    assert sentence in said(result)
    return said(result)


def as_options(settings: Iterable[str]) -> list[str]:
    """`--set KEY=VALUE` for each setting."""
    return [word for setting in settings for word in ("--set", setting)]
