"""Laws that end the program in a run, and laws whose ranges for a search are none."""

from pathlib import Path

import pytest

from tests.hertzloop.own_laws import write_law
from tests.hertzloop.processes import hertzloop
from tests.hertzloop.test_wrong_laws import LONGER, here

__all__ = ["here"]  # the fixture


@pytest.mark.full
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("raise ValueError('x')", "law mine.py: tune failed: ValueError: x (line 17)"),
        ("raise SystemExit", "law mine.py: tune failed: SystemExit (line 17)"),
        ("return [('share', 0.0, 1.0)]", "Return {key: (low, high)}"),
    ],
)
def test_ranges_that_are_none(here: Path, body: str, words: str) -> None:
    write_law(here).open("a").write(f"def tune(about):\n    {body}\n")
    done = hertzloop("tune", "--law", "mine.py", cwd=here)
    assert done.returncode == 2
    assert words in " ".join(done.stderr.split())


@pytest.mark.parametrize("transport", ["compiled", "inprocess", "zenoh"])
def test_a_law_that_ends_the_program_in_the_run(here: Path, transport: str) -> None:
    """It runs as Python; compiled it could not."""
    path = write_law(here, "if i == 3000: import sys; sys.exit(0)")
    path.write_text(path.read_text().replace("p.share *", "float(str(p.share)) *"))
    words = [
        "run",
        "aluminium-3mm",
        "--transport",
        transport,
        *LONGER,
        "--set",
        "controller.law=mine.py",
    ]
    done = hertzloop(*words, "--out", "a.mcap", cwd=here)
    assert done.returncode == 1
    said = " ".join(done.stderr.split())
    assert "the law mine.py, at sample 3000, failed: SystemExit: 0 (line" in said
