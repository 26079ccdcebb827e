"""A rectangular plate by quintic finite elements with continuous slopes: nothing of ours."""

import numpy as np
from scipy.sparse.linalg import eigsh
from skfem import Basis, BilinearForm, ElementTriArgyris, MeshTri
from skfem.helpers import dd, ddot, trace

_NEAR = 1e-9


def plate_squared(
    edges: str, size_m: tuple[float, float], nu: float, count: int, refined: int = 3
) -> np.ndarray:
    """Lowest k^2 = w sqrt(m''/B') (1/m^2), edges "cfff" at x = 0, l_x, y = 0, l_y."""

    @BilinearForm
    def bending(u, v, _):
        return (1.0 - nu) * ddot(dd(u), dd(v)) + nu * trace(dd(u)) * trace(dd(v))

    @BilinearForm
    def mass(u, v, _):
        return u * v

    mesh = MeshTri.init_sqsymmetric().refined(refined).scaled(size_m)
    basis = Basis(mesh, ElementTriArgyris(), intorder=10)
    held: set[int] = set()
    for edge, axis, place in zip(
        edges, (0, 0, 1, 1), (0.0, size_m[0], 0.0, size_m[1]), strict=True
    ):
        along = "y" if axis == 0 else "x"
        names = {"f": [], "s": ["u", f"u_{along}", f"u_{along}{along}"]}
        names["c"] = [*names["s"], "u_x", "u_y", "u_xy", "u_n"]
        if names[edge]:
            dofs = basis.get_dofs(lambda x, axis=axis, place=place: abs(x[axis] - place) < _NEAR)
            held |= set(dofs.all(names[edge]).tolist())
    k, m = bending.assemble(basis), mass.assemble(basis)
    kept = np.setdiff1d(np.arange(k.shape[0]), sorted(held))
    values = eigsh(k[kept][:, kept], k=count, M=m[kept][:, kept], sigma=-1.0)[0]
    return np.sqrt(np.maximum(np.sort(values), 0.0))
