"""A simply supported steel beam in closed form, as a file of modes for `plate.modes`.

w_n = (n pi/l)^2 sqrt(E I/(rho A)), shape sin(n pi x/l), modal mass rho A l/2. The modes beyond the
last one act as a spring: what the beam gives to a static force at the point, less what the modes
in the file do.
"""

import csv
import math
from pathlib import Path

LENGTH, WIDTH, HEIGHT = 0.8, 0.04, 0.01  # m
YOUNG, DENSITY = 210e9, 7850.0  # Pa, kg/m3
STRUCK, PUSHED = 0.31, 0.36  # m from one end
MODES = 100

bending = YOUNG * WIDTH * HEIGHT**3 / 12.0
per_length = DENSITY * WIDTH * HEIGHT
mass = per_length * LENGTH / 2.0


def shape(n: int, x: float) -> float:
    return math.sin(n * math.pi * x / LENGTH)


omega = [(n * math.pi / LENGTH) ** 2 * math.sqrt(bending / per_length) for n in range(1, MODES + 1)]
# Static deflection under a force of 1 N at the contact point: a^2 b^2/(3 E I l).
static = (STRUCK * (LENGTH - STRUCK)) ** 2 / (3.0 * bending * LENGTH)
in_file = sum(shape(n, STRUCK) ** 2 / (mass * w * w) for n, w in enumerate(omega, 1))

with Path("beam.csv").open("w", newline="") as file:
    file.write(f"# residual_flexibility_m_n = {max(static - in_file, 0.0)!r}\n")
    rows = csv.writer(file)
    rows.writerow(
        ["frequency_hz", "loss_factor", "modal_mass_kg", "shape_contact", "shape_actuator"]
    )
    for n, w in enumerate(omega, 1):
        loss = 1e-3 + 1e-6 * n  # a little more at every mode, as tests of beams show
        rows.writerow([w / (2.0 * math.pi), loss, mass, shape(n, STRUCK), shape(n, PUSHED)])
print(f"beam.csv: {MODES} modes up to {omega[-1] / (2.0 * math.pi):.4g} Hz")
