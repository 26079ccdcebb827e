"""What a law of one's own costs."""

import json
import shutil
from pathlib import Path

import pytest

from benchmarks import laws
from tests.benchmarks.programs import program


@pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")
def test_a_shipped_law_as_a_file_and_in_c_has_the_same_bytes() -> None:
    """A process of its own has them too: see tests/hertzloop/test_controller_check.py."""
    with laws.own_laws() as given:
        assert list(given) == ["shipped", "Python file", "C library"]
        assert laws.same_bytes(given)
        assert not laws.same_bytes({**given, "another": "off"})


@pytest.mark.full
def test_the_program_prints_what_own_laws_cost(tmp_path: Path) -> None:
    words = ("--rounds", "1", "--json", str(tmp_path / "a.json"))
    done = program("benchmarks.laws", *words, "-o", str(tmp_path / "laws"))
    assert done.returncode == 0, done.stderr
    data = json.loads((tmp_path / "a.json").read_text())
    assert data["same_bytes"] is True
    assert {row["task"] for row in data["rates"]} == {"sweep", "tune"}
    assert all(row["share"] == 1.0 for row in data["rates"] if row["law"] == "shipped")
    assert "Python file" in done.stdout
