"""Sound on the axis by the volume that modes move, against what is known in closed form."""

import math

import numpy as np

from hertzloop.plant.metrics.sound import Excitation, Grid, Radiator, pressure_pa
from hertzloop.plant.structures.radiation import AIR_DENSITY_KG_M3, SOUND_SPEED_M_S

AREA_M2 = 0.09
HZ = 60.0
ETA = 0.05


def piston(count: int = 1) -> Radiator:
    """Pistons on springs, of 1 kg each, the second and further ones stiffer."""
    return Radiator(
        omega=2.0 * math.pi * HZ * (1.0 + np.arange(count) / 3.0),
        eta=np.full(count, ETA),
        scale_per_kg=1.0,
        at_contact=1.0 / (1.0 + np.arange(count)),
        at_actuator=np.zeros(count),
        volume_m2=np.full(count, AREA_M2),
    )


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


def test_the_pressure_of_a_piston_is_that_of_its_volume_acceleration():
    """rho Q'/(2 pi r), later by r/c."""
    heard = pressure_pa(piston(), push(), 30.0, GRID)
    _, acceleration = motion(push(), GRID)
    expected = AIR_DENSITY_KG_M3 * AREA_M2 * acceleration / (2.0 * math.pi * 30.0)
    late = round(30.0 / SOUND_SPEED_M_S / GRID.step_s)
    assert np.abs(heard[: late - 5]).max() < 1e-3 * np.abs(expected).max()
    difference = heard[late:4000] - expected[: 4000 - late]
    assert np.abs(difference).max() < 0.05 * np.abs(expected).max()


def test_the_sound_of_five_modes_is_the_sum_of_each():
    five = piston(5)
    arrays = ("omega", "eta", "at_contact", "at_actuator", "volume_m2")
    each = [
        Radiator(scale_per_kg=1.0, **{name: getattr(five, name)[i : i + 1] for name in arrays})
        for i in range(5)
    ]
    together = pressure_pa(five, push(), 1.0, GRID)
    singly = sum(pressure_pa(one, push(), 1.0, GRID) for one in each)
    np.testing.assert_allclose(together, singly, rtol=0, atol=1e-12 * np.abs(together).max())
