"""The pictures in docs/ show what the code does today."""

import json
from pathlib import Path

import pytest

from benchmarks import pictures as drawn
from tests.benchmarks.programs import called, said

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_every_picture_of_the_documentation_is_noted() -> None:
    here = {path.name for path in DOCS.glob("*.png")}
    assert here == set(drawn.PICTURES) == set(drawn.read_notes(DOCS))


@pytest.mark.parametrize("name", drawn.PICTURES)
def test_a_picture_matches_the_code(name: str) -> None:
    """Mend: python -m benchmarks.pictures --docs -o docs --only NAME, and look at it."""
    now = drawn.note_of(drawn.PICTURES[name])
    assert drawn.differences(drawn.read_notes(DOCS)[name], now) == []
    assert now["words"] or any(now["metrics"].values())


def test_other_metrics_and_other_words_are_noticed_and_last_bits_are_not(tmp_path: Path) -> None:
    picture = drawn.Drawn("make", "x.png", (("aluminium-3mm", ("run.duration_s=0.0016",)),))
    note = json.loads(json.dumps(drawn.note_of(picture)))
    assert drawn.differences(note, drawn.note_of(picture)) == []
    (case,) = note["metrics"].values()
    exact = case["peak_force_n"]
    case["peak_force_n"] = exact * (1.0 + 1e-9)
    assert drawn.differences(note, drawn.note_of(picture)) == []
    case["peak_force_n"] = exact * (1.0 + 1e-5)
    (said,) = drawn.differences(note, drawn.note_of(picture))
    assert "peak_force_n was" in said
    stronger = drawn.Drawn(
        "make", "x.png", (("aluminium-3mm", ("run.duration_s=0.0016", "controller.kappa=0.81")),)
    )
    assert drawn.differences(note, drawn.note_of(stronger))
    worded = drawn.note_of(picture) | {"words": ["another title"]}
    assert any("words was" in one for one in drawn.differences(note, worded))


def test_a_run_for_a_picture_that_fails_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing = drawn.Run("aluminium-3mm", ("controller.kappa=much",), 0.003)
    monkeypatch.setitem(drawn.MORE, "paced", [failing])
    result = called(drawn.main, "--only", "paced", "-o", str(tmp_path))
    assert result.exit_code == 1
    assert "the paced run failed: error: " in said(result)
    assert "controller.kappa" in said(result)


def test_an_unknown_picture_is_the_users_mistake(tmp_path: Path) -> None:
    result = called(drawn.main, "--only", "none", "-o", str(tmp_path))
    assert result.exit_code == 2
    assert "--only = none: unknown picture" in said(result)
