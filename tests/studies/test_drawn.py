"""The pictures in docs/ show what the code does today."""

import json
from pathlib import Path

import pytest

from hertzloop.studies import drawn

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_every_picture_of_the_documentation_is_noted() -> None:
    here = {path.name for path in DOCS.glob("*.png")}
    assert here == set(drawn.PICTURES) == set(drawn.read_notes(DOCS))


@pytest.mark.parametrize("name", drawn.PICTURES)
def test_a_picture_matches_the_code(name: str) -> None:
    """Mend: hertzloop pictures --docs -o docs --only NAME (draws it again), and look at it."""
    now = drawn.note_of(drawn.PICTURES[name])
    assert drawn.differences(drawn.read_notes(DOCS)[name], now) == []
    assert now["words"] or any(now["figures"].values())


def test_other_figures_and_other_words_are_noticed_and_last_bits_are_not(tmp_path: Path) -> None:
    picture = drawn.Drawn("make", "x.png", (("aluminium-3mm", ("run.duration_s=0.0016",)),))
    note = json.loads(json.dumps(drawn.note_of(picture)))
    assert drawn.differences(note, drawn.note_of(picture)) == []
    (case,) = note["figures"].values()
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
