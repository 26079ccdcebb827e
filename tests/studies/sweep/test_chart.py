"""The picture of a sweep: a map over two keys of numbers, else the metrics over each key."""

import math

import pytest

from hertzloop.results.cases import SHOWN
from tests.commands import succeed

chart = pytest.importorskip("hertzloop.studies.sweep.chart")
COARSE = ["--set", "run.accuracy=0.05", "--set", "run.duration_s=0.0016", "--workers", "1"]


def row(**values):
    """A row whose metrics are all the same but those given."""
    return dict.fromkeys(SHOWN, 1.0) | values


def test_a_grid_over_two_numbers_is_a_map_of_the_metrics_that_differ():
    rows = [
        row(x=x, y=y, plate_energy_db=x + y if x else math.nan, rebound_percent=10.0 * y)
        for x in (0, 1, 2)
        for y in (0.0, 0.5, 1.0)
    ]
    axes = [ax for ax in chart.draw(rows, ["x", "y"], "grid").axes if ax.get_title()]
    assert [ax.get_title() for ax in axes] == ["plate energy", "rebound height"]
    shown = axes[0].collections[0].get_array()
    assert shown.shape == (3, 3)
    assert shown[:, 0].mask.all()  # a case without the metric is grey
    assert shown[2, 1] == pytest.approx(2.0)


@pytest.mark.parametrize("kind", ["grid", "lhs"])
def test_other_sweeps_are_drawn_over_each_key(kind):
    rows = [row(bits=i, law=law, plate_energy_db=-i) for i in (4, 8) for law in ("off", "mine")]
    sheet = chart.draw(rows, ["bits", "law"], kind)
    over_bits, over_law = sheet.axes
    assert over_bits.get_ylabel() == "plate energy (dB)"
    assert list(over_bits.lines[0].get_ydata()) == [-4.0, -4.0, -8.0, -8.0]
    assert list(over_bits.lines[1].get_ydata()) == [-4.0, -8.0]  # the mean over the laws
    assert [one.get_text() for one in over_law.get_xticklabels()] == ["off", "mine"]


def test_the_command_draws_now_and_from_finished_results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["sweep", "aluminium-3mm", *COARSE, "--over", "controller.kappa=0,0.8", "-o", "r.csv"]
    succeed(*words, "--picture", "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert "has the results of this sweep" in succeed(*words, "--picture", "b.svg")
    assert b"<svg" in (tmp_path / "b.svg").read_bytes()
