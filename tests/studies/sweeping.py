"""What the tests of sweeps share: a coarse model, the command in a process."""

import sys

COARSE = ["run.accuracy=0.05"]


def command(*words: str) -> list[str]:
    """The words that start a command in a process of its own."""
    return [sys.executable, "-m", "hertzloop", *words]
