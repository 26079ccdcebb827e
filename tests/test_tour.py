"""The tour for newcomers: its files and names exist, and a run keeps its direction."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
STOPS = re.findall(r"^\| \d+ \| `(.+?)` \| `(.+?)` \|", (ROOT / "docs/explanation/tour.md").read_text(), re.M)  # fmt: skip  # noqa: E501
MOST_RETURNS = 218  # of a run to a file that it had left; lower it when a change needs fewer


def names_in(file: Path) -> set[str]:
    """What a module defines at its top."""
    found = set()
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        for target in node.targets if isinstance(node, ast.Assign) else ():
            found |= {name.id for name in ast.walk(target) if isinstance(name, ast.Name)}
    return found


def test_the_tour_has_twelve_stops() -> None:
    assert len(STOPS) == 12
    for file, name in STOPS:
        assert name in names_in(ROOT / file), (file, name)


@pytest.mark.full
def test_a_run_seldom_comes_back_to_a_file() -> None:
    for _ in range(2):  # the first one may compile
        done = subprocess.run(
            [sys.executable, "-m", "tests.walk"], cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    *stays, counted = done.stdout.splitlines()
    assert json.loads(counted)["returns"] <= MOST_RETURNS, "\n".join(stays)
