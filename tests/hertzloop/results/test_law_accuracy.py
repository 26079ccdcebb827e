"""A run says where twice the modes change what its law does by more than was asked."""

from math import nan

import pytest

from hertzloop.results.law_accuracy import LawAccuracy, simulated_law_accuracy, stated_error
from hertzloop.results.verification import Verification
from hertzloop.scene.setup import load
from tests.commands import as_options, succeed
from tests.hertzloop.scenes import aluminium_3mm, json_in

# A threshold that the slope passes within the error of the modes at 1e-3, between two samples.
NEAR = [
    "sphere.radius_m=0.01118",
    "sphere.drop_height_m=0.06053",
    "plate.size_m=[0.2332, 0.2846]",
    "plate.thickness_m=0.001976",
    "plate.contact_point_m=[0.1741, 0.1999]",
    "contact.plasticity=thornton",
    "contact.limiting_pressure_pa=1.035e9",
    "controller.kappa=0.626",
    "run.duration_s=0.0015",
    "run.lead_in_s=1e-5",
]


def test_a_run_states_the_larger_error():
    """Twice the modes that change more than expected, if only by half, are the model error."""
    changed = Verification(0.0015, 1e-4, 1e-4, 1000.0, 3e5)
    found = LawAccuracy(changed, asked=1e-3, expected=9e-4, delay_us=nan, finer_delay_us=nan)
    assert not found.kept
    assert stated_error(9e-4, found) == 0.0015
    assert stated_error(0.02, found) == 0.02
    kept = LawAccuracy(changed, asked=2e-3, expected=9e-4, delay_us=nan, finer_delay_us=nan)
    assert stated_error(9e-4, kept) == 9e-4
    assert stated_error(9e-4, None) == 9e-4
    assert stated_error(None, found) is None


@pytest.mark.parametrize("name", ["aluminium-3mm", "aluminium-20mm", "oak-20mm", "offcentre-6mm"])
def test_shipped_scenes_keep_it(name):
    found = simulated_law_accuracy(load(name, ["controller.law=slope_threshold"]), 5e-3)
    assert found.kept


@pytest.mark.parametrize(
    "settings",
    [
        ["controller.law=off"],
        ["run.scheme=thesis2008"],
        ["run.plate_model=infinite"],
        ["run.accuracy=1e-4"],  # the step carries no more modes
        ["plate.edges=cccc"],
        ["run.duration_s=0.00101"],  # the contact does not end
        ["run.duration_s=0.0005"],
    ],
)
def test_where_nothing_can_be_said(settings):
    assert simulated_law_accuracy(aluminium_3mm(*settings), 2e-3) is None


@pytest.mark.full
@pytest.mark.parametrize(("v_thr_m_s", "kept"), [(-0.442, False), (-0.48, True)])
def test_a_run_says_so(tmp_path, v_thr_m_s, kept):
    settings = as_options([*NEAR, f"controller.v_thr_m_s={v_thr_m_s}"])
    out = ["--transport", "compiled", "--out", tmp_path / "a.mcap", "--json", tmp_path / "a.json"]
    told = succeed("run", "aluminium-3mm", *settings, *out)
    report = json_in(tmp_path / "a.json")
    assert report["law_accuracy"]["kept"] is kept
    assert ("Accuracy missed: twice the modes" in told) is not kept
    assert any("Accuracy missed" in sentence for sentence in report["verdict"]) is not kept
