"""The count of unstable poles of random loops, and laws whose class is known."""

import numpy as np
import pytest

from benchmarks.margin import dense, laws, own_laws, synthetic
from hertzloop.scene.setup import load
from hertzloop.studies.margin.growth import growth_of
from hertzloop.studies.margin.linear import TransferFunction
from hertzloop.studies.margin.loop import PolyphaseLoop, loops_of
from hertzloop.studies.margin.poles import closed_loop_poles
from hertzloop.studies.margin.table import Loop
from tests.tiers import default


@pytest.mark.parametrize("seed", default([7, 9], [7]))  # in 9, conjugate starts never converged
def test_counts_of_hard_loops_agree_with_all_poles(seed):
    checks = list(synthetic(seed, 150))
    assert [c for c in checks if not c.agrees] == []
    assert sum(c.predicted > 0 for c in checks) > 50


@pytest.mark.parametrize("modes", default([(20, 40), (20, 40, 80)], quick=[(20, 40)]))
def test_counts_agree_with_eigenvalues(modes):
    assert [c for c in dense(7, modes) if not c.agrees] == []


def test_a_loop_without_gain_at_rest_has_no_points_where_it_is_rounding_alone():
    """An acceleration is zero at rest: near zero frequency its loop gain is 1e-12 of rounding."""
    law = "controller.law=acceleration_feedback"
    loops = loops_of(load("aluminium-20mm", [law, "run.accuracy=0.05"]))
    assert isinstance(loops, PolyphaseLoop)
    theta = loops.at(0)[0].table.theta
    assert 1000 < len(theta) < 20_000
    assert np.count_nonzero(theta < 1e-9) < 100


def test_a_dip_below_one_between_the_points_is_found():
    """|L| falls below 1 by 1e-5 over a millionth of the circle between two resonances."""
    poles = np.exp(np.array([-1e-7 + 0.002j, -1e-7 + 0.0045j]))
    plant = TransferFunction.of_modes(
        poles, np.array([0.5 + 0j, 0.5 + 0j]), np.array([0.0, 0.3, 0.0])
    )
    theta = np.linspace(0.002001, 0.004499, 200_001)
    least = np.exp(Loop(plant, TransferFunction.of_taps(1.0)).log_gain(theta)[0].real.min())
    dip = TransferFunction.of_taps(-(1.0 - 1e-5) / least)
    arcs = Loop(plant, dip).table.arcs
    assert len(arcs) >= 2
    assert any(0.002 < arc.end < 0.0045 for arc in arcs)


@pytest.mark.parametrize("taps", [[0.3], [0.0, -0.2, 0.5], [0.1] * 12])
def test_a_finite_impulse_response_closes_the_loop(taps):
    plant = TransferFunction.of_modes(
        np.exp([-0.01 + 0.5j, -0.02 + 1.7j]), np.full(2, 0.2 + 0j), np.zeros(3)
    )
    law = TransferFunction.of_taps(-0.4, *taps)
    found = closed_loop_poles(plant, law, 3)
    assert len(found) == 4 + 3 + len(taps)
    gain = 1.0 + Loop(plant, law).gain(found) * found**-3.0
    assert np.abs(gain).max() < 1e-9
    count = Loop(plant, law).table.unstable(np.array([3]))[0]
    assert count == np.sum(np.abs(found) > 1.0)


@pytest.mark.full
def test_laws_of_a_user_are_classified():
    assert [c.case for c in own_laws(laws()) if not c.agrees] == []


@pytest.mark.parametrize(("kappa", "stable"), [(0.4, False), (0.01, True)])
def test_a_loop_with_too_many_states_has_a_count_alone(kappa, stable):
    settings = [f"controller.kappa={kappa}", "controller.latency_us=12000", "run.duration_s=0.05"]
    found = growth_of(load("oak-20mm", ["controller.law=velocity_feedback", *settings]))
    assert found is not None
    assert (found.unstable_poles == 0) == stable
    assert found.per_s == (0.0 if stable else None)
