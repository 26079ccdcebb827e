"""Numbers of runs on the pages are those on the screen, with the same name."""

import re
from pathlib import Path

import pytest

import hertzloop
from hertzloop.results.metric_rows import row_of
from hertzloop.views.digits import change_text
from tests.commands import succeed

DOCS = Path(__file__).resolve().parent.parent / "docs"
EARLY = {"controller.v_thr_m_s": -0.9}
pytestmark = pytest.mark.usefixtures("shipped_scenes")


def change_of(scene: str, keys: dict[str, object]) -> str:
    """The change of the plate energy in the first impact as a run prints it, in dB."""
    run = hertzloop.simulate(hertzloop.load(scene, keys))
    row = row_of(run.rows, "first_impact", "plate_energy_j")
    assert row is not None
    return change_text(row).removesuffix(" dB")


@pytest.mark.parametrize(
    ("scene", "keys", "row"),
    [
        ("aluminium-20mm", {}, "| `aluminium-20mm` | -0.25 | 0 | {} |"),
        ("aluminium-20mm", {"controller.latency_us": 30}, "| `aluminium-20mm` | -0.25 | 30 | {} |"),
        ("aluminium-3mm", {}, "| `aluminium-3mm` | -0.25 | 0 | {} |"),
        ("aluminium-3mm", EARLY, "| `aluminium-3mm` | -0.9 | 0 | {} |"),
        ("aluminium-3mm", EARLY | {"controller.latency_us": 2}, "| -0.9 | 2 | {} |"),
        ("aluminium-3mm", EARLY | {"controller.latency_us": 5}, "| -0.9 | 5 | {} |"),
    ],
)
def test_the_table_of_the_first_run(scene, keys, row):
    """First impact alone, so that a short run is enough for a small sphere."""
    short = {"run.duration_s": 0.0015} if scene == "aluminium-3mm" else {}
    page = (DOCS / "tutorials" / "first-run.md").read_text()
    assert row.format(change_of(scene, keys | short)) in page


@pytest.mark.full
def test_the_sentences_on_runs_of_the_default_scene_and_of_an_own_law(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    succeed("law", "new", "mine.py")
    text = Path("mine.py").read_text()
    [line] = re.findall(r"^    return p\.factor .*$", text, re.M)
    limited = line.replace("return ", "return min(") + ", 300.0)"
    Path("limited.py").write_text(text.replace(line, limited))
    first_run, own_law = (
        " ".join((DOCS / "tutorials" / name).read_text().split())
        for name in ("first-run.md", "own-law.md")
    )
    shipped = hertzloop.simulate("aluminium-20mm").verdict
    reduces = "the plate energy by {} dB in the first impact"
    by = [re.findall(r"by ([\d.]+(?: to [\d.]+)?) dB", shipped[0])[0]]
    assert reduces.format(by[0]) in first_run
    assert re.findall(r"Over all contacts the change is .*? dB", shipped[1])[0] in first_run
    for law, kappa, words in (
        ("mine.py", 0.8, "reduces the plate energy of the default scene by {} dB in the first"),
        ("mine.py", 0.5, "reduces the plate energy by {} dB in the first impact. Now"),
        ("limited.py", 0.8, "reduces the plate energy by {} dB in the first impact. A mistake"),
    ):
        keys = {"controller.law": law, "controller.kappa": kappa}
        change = change_of("aluminium-20mm", keys).lstrip("-")
        assert words.format(change) in own_law, (law, kappa, change)
