"""The tour for newcomers: its files and names exist."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STOPS = re.findall(r"^\| \d+ \| `(.+?)` \| `(.+?)` \|", (ROOT / "docs/explanation/tour.md").read_text(), re.M)  # fmt: skip  # noqa: E501


def names_in(file: Path) -> set[str]:
    """What a module defines at its top."""
    found = set()
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        for target in node.targets if isinstance(node, ast.Assign) else ():
            found |= {name.id for name in ast.walk(target) if isinstance(name, ast.Name)}
    return found


def test_the_tour_leads_through_files_that_exist():
    assert len(STOPS) == 28
    for file, name in STOPS:
        assert name in names_in(ROOT / file), (file, name)
