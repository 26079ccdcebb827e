"""Pictures that need no explaining: scales, words on axes, legends that hide nothing."""

import pytest

from hertzloop.studies.pages import words
from hertzloop.studies.pages.pictures import round_above
from hertzloop.studies.tune.chart import front_sheet
from hertzloop.studies.tune.result import Candidate, TuneResult


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
    assert ax.get_ylabel() == "peak contact force (N)"
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
        assert words.against_none(figure).endswith(("(dB)", "(%)", "(N)", "(N s)", "(mm)", "(J)"))
