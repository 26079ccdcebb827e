"""Laws of one's own for tests, in a folder that holds nothing else."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
HEADER = ROOT / "controller" / "loading" / "start" / "hertzloop_law.h"
SHORT = "run.duration_s=0.0016"
needs_cc = pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")

# A share of the contact force; `{line}` comes before the command is returned.
ECHO = """
from hertzloop.law import Field, Keys

senses = "contact_force"

class Parameters(Keys):
    share: float = Field(0.5, ge=-1.0, le=1.0)

class State:
    largest_n: float = 0.0

def command(p, s, samples, i):
    s.largest_n = max(s.largest_n, samples[i])
    {line}
    return p.share * samples[i]
"""


def write_law(folder: Path, line: str = "pass", name: str = "mine.py") -> Path:
    """A law with a line of its own."""
    path = folder / name
    path.write_text(ECHO.format(line=line), encoding="utf-8")
    return path


def build(folder: Path, source: Path, *options: str) -> Path:
    """A law in C as a shared library in `folder`, the header beside it as for a user."""
    shutil.copy(HEADER, folder)
    copied = folder / source.name
    if copied != source:
        shutil.copy(source, copied)
    library = copied.with_suffix(".so")
    words = ["cc", "-O2", "-Wall", "-Werror", "-fPIC", "-shared", "-ffp-contract=off", *options]
    subprocess.run([*words, str(copied), "-o", str(library), "-lm"], check=True)
    return library
