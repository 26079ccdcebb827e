"""Records of a solver that shares nothing with the package."""

import numpy as np
import pytest
import scipy

from hertzloop.fitting.fit.results import ModelVerdict
from hertzloop.fitting.records.record import Record
from tests.fitting.fit.drops import BALLS, PLATES, Drop, scene_of
from tests.fitting.fitting import (
    RADIUS,
    THICKNESS,
    assert_holds,
    fitted,
    scene,
)


def of_drop(
    drop: Drop,
    quantity: str,
    duration_s: float,
    seed: int,
    lead_s: float = 250e-6,
    interval_s: float = 0.5e-6,
    noise: float = 0.003,
) -> Record:
    """A record with noise relative to its peak, of a gain 1 % and a clock 30 ppm off."""
    time_s, force, speed = drop.simulate(duration_s)
    moved = scipy.integrate.cumulative_trapezoid(speed, time_s, initial=0.0)
    true = {"contact_force": force, "v_p": speed, "xi_p": moved}[quantity]
    generator = np.random.default_rng(seed)
    tau = np.arange(-lead_s + generator.uniform() * interval_s, duration_s, interval_s)
    clean = np.where(
        tau > 0.0, scipy.interpolate.CubicSpline(time_s, true)(np.maximum(tau, 0.0)), 0.0
    )
    error = noise * np.max(np.abs(clean)) * generator.standard_normal(len(tau))
    return Record("drop", 0.0123 + tau * (1.0 + 3e-5), 1.01 * clean + error, quantity)


def test_a_record_of_another_solver_is_fitted():
    drop = Drop(thickness=3.2e-3)
    start = scene("plate.loss_factor=1e-3")
    found = fitted(start, of_drop(drop, "v_p", 6e-4, 77), THICKNESS, RADIUS)
    assert found.model is ModelVerdict.FITS
    assert_holds(found, drop.thickness, drop.radius)


OTHER_PLATES = [  # ball, plate; radius, height, thickness; duration; start over the truth
    ("glass", "aluminium", (3.1e-3, 0.12, 19.4e-3), 118e-6, (1.2, 1.0)),
    ("tungsten carbide", "brass", (4.2e-3, 0.16, 16.4e-3), 214e-6, (0.83, 1.2)),
    ("glass", "glass", (10.1e-3, 0.12, 1.52e-3), 851e-6, (0.83, 1.2)),
]


@pytest.mark.parametrize(
    ("ball", "plate", "sizes", "duration_s", "off"),
    [
        OTHER_PLATES[0],
        *(pytest.param(*one, marks=pytest.mark.full) for one in OTHER_PLATES[1:]),
    ],
)
def test_plates_of_other_materials_are_found_from_a_start_20_percent_off(
    ball, plate, sizes, duration_s, off
):
    """In a few contacts their vibrations are out of phase: the first window has to be short."""
    drop = Drop(*sizes, of_ball=BALLS[ball], of_plate=PLATES[plate])
    true = {THICKNESS: drop.thickness, RADIUS: drop.radius}
    start = scene_of(drop).vary({key: f * true[key] for key, f in zip(true, off, strict=True)})
    keys = [key for key, factor in zip(true, off, strict=True) if factor != 1.0]
    found = fitted(start, of_drop(drop, "v_p", duration_s, 5), *keys)
    assert found.model is ModelVerdict.FITS
    assert_holds(found, *(true[key] for key in keys))


def test_a_record_without_noise_is_as_exact_as_the_simulation():
    drop = Drop(radius=3.1e-3)
    time_s, force, _ = drop.simulate(80e-6)
    tau = np.arange(-250e-6, 80e-6, 0.5e-6)
    clean = np.interp(tau, time_s, force)
    found = fitted(
        scene("plate.loss_factor=1e-3"), Record("r", tau, clean, "contact_force"), RADIUS
    )
    assert found.estimates[0].value == pytest.approx(3.1e-3, rel=1e-4)
    assert found.model is ModelVerdict.FITS


@pytest.mark.full
def test_waves_from_the_edges_that_fit_almost_as_well_a_period_later_are_told_apart():
    drop = Drop(
        2.605e-3,
        0.271,
        1.393e-3,
        7e-4,
        size=0.455,
        of_ball=BALLS["alumina"],
        of_plate=PLATES["steel"],
    )
    start = scene_of(drop).vary({THICKNESS: 1.403e-3, RADIUS: 3.113e-3})
    one = of_drop(drop, "xi_p", 250e-6, 1, lead_s=110e-6, interval_s=0.178e-6, noise=0.01)
    found = fitted(start, one, THICKNESS, RADIUS)
    assert found.model is ModelVerdict.FITS
    assert [e.value for e in found.estimates] == pytest.approx([1.393e-3, 2.605e-3], rel=0.01)
