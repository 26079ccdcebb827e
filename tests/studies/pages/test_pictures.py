"""Pictures that need no explaining: scales, words on axes, legends that hide nothing."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from benchmarks.latency_pictures import draw_maps
from hertzloop.studies.pages import pictures, words
from hertzloop.studies.pages.pictures import round_above
from hertzloop.studies.tune.chart import front_sheet
from hertzloop.studies.tune.result import Candidate, TuneResult


@pytest.fixture
def saved(monkeypatch):
    """Figures instead of files."""
    found: list[Figure] = []

    def keep(figure: Figure, path: Path) -> Path:
        found.append(figure)
        figure.draw_without_rendering()
        return path

    monkeypatch.setattr(pictures, "save", keep)
    return found


def rows(key: str, values: list[Any]) -> list[dict[str, Any]]:
    """A made-up map: plate energy from -2.274 to 3.1 dB, radiated energy hardly anything."""
    cases = [(latency, value) for latency in range(0, 30, 5) for value in values]
    energies = np.linspace(-2.274, 3.1, len(cases))
    return [
        {
            "controller.latency_us": latency,
            key: value,
            "plate_energy_db": float(energy),
            "radiated_db": 1e-3 * float(energy),
            "rebound_percent": 100.0 + 40.0 * float(energy),
        }
        for (latency, value), energy in zip(cases, energies, strict=True)
    ]


def test_a_row_of_maps_has_one_round_scale_around_zero(saved):
    maps = {
        "sensors.bits": rows("sensors.bits", [3, 4, 5, 6]),
        "controller.kappa": rows("controller.kappa", [0.0, 0.5, 1.0]),
    }
    maps["sensors.bits"][3]["plate_energy_db"] = None
    names = ("plate_energy_db", "radiated_db", "rebound_percent")
    draw_maps(Path("x.png"), "made up", maps, {name: words.METRICS[name] for name in names})
    (figure,) = saved
    bars = [ax for ax in figure.axes if ax.get_label() == "<colorbar>"]
    assert [bar.get_ylabel() for bar in bars] == [
        "plate energy:\nchange (dB)",
        "rebound height:\nchange (points)",
    ]
    assert [bar.get_yticks().tolist() for bar in bars] == [
        [-4.0, -2.0, 0.0, 2.0, 4.0],
        [-200.0, -100.0, 0.0, 100.0, 200.0],
    ]
    assert "radiated energy" in figure.get_suptitle()  # left out, and said so
    drawn = [ax for ax in figure.axes if ax not in bars]
    assert len(drawn) == 4
    assert {ax.get_ylabel() for ax in drawn} == {"bits of the sensor", "kappa"}
    bits = next(ax for ax in drawn if ax.get_ylabel().startswith("bits"))
    assert all(float(tick).is_integer() for tick in bits.get_yticks())
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["as without control", "unstable"]


@pytest.mark.parametrize(
    ("value", "above"), [(2.274, 4.0), (0.9, 1.0), (1.0, 1.0), (41.3, 100.0), (0.051, 0.1)]
)
def test_scales_are_rounded_up(value, above):
    assert round_above(value) == pytest.approx(above)


def test_a_front_is_labelled_in_words_beside_its_points():
    figures = {"plate_energy_db": -3.0, "peak_force_n": 40.0}
    best = Candidate({"controller.law": "shifted_threshold"}, figures)
    result = TuneResult(tuple(figures), "impact", {}, [best], best, [], 1, 1)
    figure = front_sheet("made up", result)
    figure.draw_without_rendering()
    (ax,) = figure.axes
    assert ax.get_xlabel() == "plate energy against no control (dB)"
    assert ax.get_ylabel() == "largest contact force (N)"
    assert ax.get_legend() is None
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "shifted threshold",
        "published setting",
    ]
    assert not legend.get_window_extent().overlaps(ax.get_window_extent())


def test_every_objective_has_words():
    from hertzloop.results.cases import OBJECTIVES

    for figure in OBJECTIVES:
        assert "_" not in words.against_none(figure)
        assert words.against_none(figure).endswith(("(dB)", "(%)", "(N)", "(N s)", "(mm)"))
