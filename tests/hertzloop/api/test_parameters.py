"""Errors in Python name parameters, not options of the command line."""

import pytest

import hertzloop
from hertzloop.api.parameters import named_as_parameters


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("--over a.b: is drawn by --uncertain.", "over a.b: is drawn by uncertain."),
        ("Use --at-most. Or hertzloop run --pace 1.", "Use at_most. Or hertzloop run --pace 1."),
        ("--out = a.txt: wrong", "recording = a.txt: wrong"),
    ],
)  # fmt: skip
def test_options_become_parameters(options, expected):
    assert named_as_parameters(options) == expected


def test_a_study_names_its_parameters(tmp_path):
    with pytest.raises(hertzloop.DesignError, match=r"^over run\.seed=0:9 has no step"):
        hertzloop.sweep("aluminium-3mm", {"run.seed": "0:9"})
    with pytest.raises(hertzloop.SceneError, match=r"^uncertain = .*none\.toml: cannot be read"):
        hertzloop.budget("aluminium-3mm", uncertain=tmp_path / "none.toml")
    with pytest.raises(ValueError, match=r"^minimise = 'x': unknown metric"):
        hertzloop.tune("aluminium-3mm", minimise=["x"])
