"""An L-shaped aluminium plate by finite elements, as a file of modes for `plate.modes`.

Kirchhoff's plate with Argyris elements (quintic, continuous slopes) of scikit-fem, clamped along
its lower edge and free elsewhere. The shapes go onto a grid for the replay too, zero outside the L.
"""

import math

import numpy as np
from scipy.sparse.linalg import eigsh
from skfem import Basis, BilinearForm, ElementTriArgyris, MeshTri
from skfem.helpers import dd, ddot, trace

SIDE, THICKNESS = 0.2, 0.004  # m; the L has the corners (0, 0), (SIDE, 0) ... and one cut out
YOUNG, DENSITY, POISSON, LOSS = 7.2e10, 2700.0, 0.34, 1e-3
STRUCK, PUSHED = (0.06, 0.13), (0.05, 0.12)  # m
MODES = 100

stiffness = YOUNG * THICKNESS**3 / (12.0 * (1.0 - POISSON**2))
mass_per_area = DENSITY * THICKNESS


@BilinearForm
def bending(u, v, _):
    """Energy of bending over stiffness."""
    plain, twisted = trace(dd(u)) * trace(dd(v)), ddot(dd(u), dd(v))
    return POISSON * plain + (1.0 - POISSON) * twisted


@BilinearForm
def inertia(u, v, _):
    """Mass over mass per area."""
    return u * v


half = SIDE / 2.0
lower = MeshTri.init_tensor(np.linspace(0.0, SIDE, 9), np.linspace(0.0, half, 5))
upper = MeshTri.init_tensor(np.linspace(0.0, half, 5), np.linspace(half, SIDE, 5))
mesh = lower + upper  # nodes on the common edge become one
basis = Basis(mesh, ElementTriArgyris(), intorder=10)
# Clamped: no deflection and no slope, nor their derivatives along the edge.
held = basis.get_dofs(lambda x: x[1] < 1e-9).all(["u", "u_x", "u_y", "u_xx", "u_xy", "u_n"])
kept = np.setdiff1d(np.arange(basis.N), held)
k, m = (form.assemble(basis)[kept][:, kept] for form in (bending, inertia))
values, vectors = eigsh(k, k=MODES, M=m, sigma=0.0)
order = np.argsort(values)
frequency = np.sqrt(values[order] * stiffness / mass_per_area) / (2.0 * math.pi)
coefficients = np.zeros((basis.N, MODES))
coefficients[kept] = vectors[:, order]


def at(points: np.ndarray) -> np.ndarray:
    """Shapes at points (points, 2), with a unit integral of their square: (modes, points)."""
    return np.asarray((basis.probes(points.T) @ coefficients).T)


x = y = np.linspace(0.0, SIDE, 21)
grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
inside = (grid[:, 0] <= half) | (grid[:, 1] <= half)
shapes = np.zeros((MODES, len(grid)))
shapes[:, inside] = at(grid[inside])
contact, actuator = at(np.array([STRUCK, PUSHED])).T
np.savez_compressed(
    "l_shaped.npz",
    frequency_hz=frequency,
    loss_factor=np.full(MODES, LOSS),
    modal_mass_kg=np.full(MODES, mass_per_area),  # of a shape with a unit integral of its square
    shape_contact=contact,
    shape_actuator=actuator,
    x_m=x,
    y_m=y,
    shape_grid=shapes.reshape(MODES, len(x), len(y)),
)
print(f"l_shaped.npz: {MODES} modes up to {frequency[-1]:.4g} Hz, the first {frequency[0]:.4g} Hz")
