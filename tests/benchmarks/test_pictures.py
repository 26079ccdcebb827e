"""The pictures in docs/ show what the code does today."""

from pathlib import Path

import pytest

from benchmarks import pictures as drawn

pytestmark = pytest.mark.usefixtures("shipped_scenes")
DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_every_picture_of_the_documentation_is_noted():
    assert {path.name for path in DOCS.glob("*.png")} == set(drawn.read_notes())


@pytest.mark.full
@pytest.mark.parametrize("name", drawn.read_notes())
def test_a_picture_matches_the_code(name):
    """Mend: python -m benchmarks.pictures --docs -o docs --only NAME, and look at it."""
    noted = drawn.read_notes()[name]
    now = drawn.note_of(noted)
    assert drawn.differences(noted, now) == []
    assert now["words"] or any(now["metrics"].values())
