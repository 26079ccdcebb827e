"""The project's static checks: formatting, lint, types, and who may import whom."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = Path(sys.executable).parent


@pytest.mark.parametrize(
    "command",
    [
        "ruff format --check .",
        "ruff check .",
        "pyrefly check --output-format min-text",
        "lint-imports",
        pytest.param("mypy", marks=pytest.mark.full),
    ],
)
def test_check(command):
    program, *words = command.split()
    done = subprocess.run([SCRIPTS / program, *words], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
