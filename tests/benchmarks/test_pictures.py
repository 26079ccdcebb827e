"""The pictures in docs/ show what the code does today."""

from pathlib import Path

import pytest

from benchmarks import pictures as drawn
from tests.benchmarks.programs import called, said

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


def test_other_metrics_and_other_words_are_noticed_and_last_bits_are_not():
    case = "aluminium-3mm run.duration_s=0.0016"
    now = drawn.note_of({"metrics": {case: {}}, "replayed": None})
    force = now["metrics"][case]["peak_force_n"]
    for factor, noticed in ((1.0, False), (1.0 + 1e-9, False), (1.0 + 1e-5, True)):
        metrics = {case: now["metrics"][case] | {"peak_force_n": factor * force}}
        found = drawn.differences(now | {"metrics": metrics}, now)
        assert bool(found) == noticed
        assert all("peak_force_n was" in one for one in found)
    [words] = drawn.differences(now, now | {"words": ["another title"]})
    assert "words was" in words


@pytest.mark.full
def test_a_run_for_a_picture_that_fails_says_why(tmp_path, monkeypatch):
    failing = drawn.Run("aluminium-3mm", ("controller.kappa=much",), 0.003)
    monkeypatch.setitem(drawn.MORE, "paced", failing)
    result = called(drawn.main, "--only", "paced", "-o", str(tmp_path))
    assert result.exit_code == 1
    assert "the paced run failed: error: " in said(result)
    assert "controller.kappa" in said(result)
