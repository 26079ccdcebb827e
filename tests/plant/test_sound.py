"""Rayleigh's integral over modes against what is known in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.plant.metrics.sound import (
    Excitation,
    Grid,
    Products,
    Radiator,
    pressure_pa,
    radiated_j,
    rung_j,
)
from hertzloop.plant.structures.radiation import AIR_DENSITY_KG_M3, SOUND_SPEED_M_S

SIDE = 0.3
HZ = 60.0
ETA = 0.05
NODES = (np.arange(24) + 0.5) * (SIDE / 24)


def first_mode(shape: np.ndarray | None = None) -> tuple[Radiator, Products]:
    """One mode of a plate, of 1 kg modal mass: (1, 1), or with the shape given."""
    along = np.sin(np.pi * NODES / SIDE)
    shapes = np.outer(along, along) if shape is None else shape
    xx, yy = np.meshgrid(NODES, NODES, indexing="ij")
    radiator = Radiator(
        omega=np.array([2.0 * math.pi * HZ]),
        eta=np.array([ETA]),
        scale_per_kg=1.0,
        at_contact=np.array([1.0]),
        at_actuator=np.array([0.0]),
        shapes=shapes.reshape(1, -1),
        places_m=np.stack([xx.ravel(), yy.ravel()], axis=1),
        area_m2=np.full(xx.size, (SIDE / 24) ** 2),
    )
    return radiator, Products(along[None, :], NODES, along[None, :], NODES)


def push(steps: int = 40_000, step_s: float = 2e-5) -> Excitation:
    """A smooth push of 5 ms."""
    force = np.zeros(steps)
    force[:250] = np.sin(np.pi * np.arange(250) / 250) ** 2
    return Excitation(force, np.zeros(steps), step_s)


def motion(drive: Excitation, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and acceleration of the mode by small steps, at the grid's times."""
    omega, h = 2.0 * math.pi * HZ, drive.step_s
    q = v = 0.0
    found = np.empty((2, len(drive.contact_n)))
    for i, force in enumerate(drive.contact_n):
        a = force - ETA * omega * v - omega**2 * q
        found[:, i] = v, a
        v += h * a
        q += h * v
    times = np.arange(grid.count) * grid.step_s
    v_at, a_at = (np.interp(times, np.arange(len(row)) * h, row) for row in found)
    return v_at, a_at


GRID = Grid(count=4800, step_s=1e-4, up_to_hz=2000.0)


def test_far_above_a_small_piston_the_pressure_is_that_of_a_point_source():
    """rho V'/(2 pi r) with the flow of all of the plate, later by r/c."""
    radiator, _ = first_mode(np.ones((24, 24)))
    heard = pressure_pa(radiator, push(), np.array([SIDE / 2, SIDE / 2, 30.0]), GRID)
    _, acceleration = motion(push(), GRID)
    expected = AIR_DENSITY_KG_M3 * SIDE**2 * acceleration / (2.0 * math.pi * 30.0)
    late = round(30.0 / SOUND_SPEED_M_S / GRID.step_s)
    assert np.abs(heard[: late - 5]).max() < 1e-3 * np.abs(expected).max()
    difference = heard[late:4000] - expected[: 4000 - late]
    assert np.abs(difference).max() < 0.05 * np.abs(expected).max()


def test_the_energy_of_a_mode_is_that_of_its_known_efficiency():
    """Wallace 1972, mode (1, 1), long waves: sigma = 32 k^2 lx ly/pi^5."""
    radiator, products = first_mode()
    found_j = radiated_j(radiator, products, push(), GRID)
    velocity, _ = motion(push(), GRID)
    spectrum = np.abs(np.fft.rfft(velocity, 8 * GRID.count)) ** 2
    k = 2.0 * math.pi * np.fft.rfftfreq(8 * GRID.count, GRID.step_s) / SOUND_SPEED_M_S
    share = float(np.sum(spectrum * 32.0 * k**2 * SIDE**2 / math.pi**5) / np.sum(spectrum))
    squares = float(np.sum(velocity**2)) * GRID.step_s * SIDE**2 / 4.0
    expected_j = AIR_DENSITY_KG_M3 * SOUND_SPEED_M_S * share * squares
    assert 10.0 * math.log10(found_j / expected_j) == pytest.approx(0.0, abs=0.5)


def test_the_sound_of_five_modes_is_the_sum_of_each():
    one, _ = first_mode()
    ratios = 1.0 + np.arange(5) / 3.0
    parts = ("omega", "eta", "at_contact", "at_actuator", "shapes")
    modes = [
        replace(one, omega=one.omega * ratio, at_contact=1.0 / ratio * one.at_contact)
        for ratio in ratios
    ]
    five = replace(
        one, **{name: np.concatenate([getattr(mode, name) for mode in modes]) for name in parts}
    )
    above, drive = np.array([0.1, 0.2, 1.0]), push()
    each = [pressure_pa(mode, drive, above, GRID) for mode in modes]
    together = pressure_pa(five, drive, above, GRID)
    np.testing.assert_allclose(together, sum(each), rtol=0, atol=1e-12 * np.abs(together).max())
    singly = np.concatenate([rung_j(mode, drive, GRID) for mode in modes], axis=1)
    np.testing.assert_allclose(rung_j(five, drive, GRID), singly, rtol=1e-12)


def test_no_force_no_sound():
    radiator, products = first_mode()
    silent = Excitation(np.zeros(1000), np.zeros(1000), 2e-5)
    assert not pressure_pa(radiator, silent, np.array([0.1, 0.1, 1.0]), GRID).any()
    assert radiated_j(radiator, products, silent, GRID) == 0.0
