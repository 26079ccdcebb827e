"""The deflecting plate and the sphere as meshes of a 3D view, drawn larger than life."""

import math

import numpy as np

from recordings.replay_data import Deflection

_DRAWN_SHARE = 0.12  # largest deflection as drawn, of the plate's shorter side
_SPHERE_SHARE = 0.05  # smallest radius as drawn
_FLAT_M = 1e-15  # less than this is no deflection
_LOW, _REST, _HIGH = (np.array(c) for c in ((38, 98, 214), (196, 204, 214), (226, 84, 44)))


def exaggeration(deflection: Deflection) -> float:
    """Factor for heights: 1, 2 or 5 times a power of ten, so that the largest deflection shows."""
    largest = float(abs(deflection.w_m).max(initial=0.0))
    if largest < _FLAT_M:
        return 1.0
    wanted = _DRAWN_SHARE * _shorter_side(deflection) / largest
    power = 10.0 ** math.floor(math.log10(wanted))
    return power * max(step for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9))


def sphere_radius_drawn_m(deflection: Deflection, radius_m: float) -> float:
    """Radius of the sphere as drawn: its own, or what is just visible beside the plate."""
    return max(radius_m, _SPHERE_SHARE * _shorter_side(deflection))


def _shorter_side(deflection: Deflection) -> float:
    return float(min(deflection.x_m[-1], deflection.y_m[-1]))


def triangles(deflection: Deflection) -> np.ndarray:
    """Vertex indices of the triangles, shape (triangles, 3); vertex (i, j) is i * ny + j."""
    nx, ny = len(deflection.x_m), len(deflection.y_m)
    corner = (np.arange(nx - 1)[:, None] * ny + np.arange(ny - 1)).ravel()
    lower = np.stack([corner, corner + ny, corner + 1], axis=1)
    upper = np.stack([corner + 1, corner + ny, corner + ny + 1], axis=1)
    return np.concatenate([lower, upper]).astype(np.uint32)


def vertices(deflection: Deflection, factor: float) -> np.ndarray:
    """Positions with the heights multiplied, shape (frames, nodes, 3), m."""
    frames, nx, ny = deflection.w_m.shape
    found = np.empty((frames, nx, ny, 3), np.float32)
    found[..., 0] = deflection.x_m[:, None]
    found[..., 1] = deflection.y_m
    found[..., 2] = factor * deflection.w_m
    return found.reshape(frames, nx * ny, 3)


def normals(deflection: Deflection, factor: float) -> np.ndarray:
    """Unit normals of the surface as drawn, shape (frames, nodes, 3)."""
    w = factor * deflection.w_m
    slope_x, slope_y = np.gradient(w, deflection.x_m, deflection.y_m, axis=(1, 2))
    found = np.stack([-slope_x, -slope_y, np.ones_like(w)], axis=-1)
    found /= np.linalg.norm(found, axis=-1, keepdims=True)
    return found.reshape(len(w), -1, 3).astype(np.float32)


def colours(deflection: Deflection) -> np.ndarray:
    """Blue below and red above rest, shape (frames, nodes), 0xRRGGBBAA.

    Full colour is at two fifths of the largest deflection of the frames, so that waves far
    from the contact show.
    """
    full = 0.4 * max(float(abs(deflection.w_m).max(initial=0.0)), _FLAT_M)
    share = np.clip(deflection.w_m / full, -1.0, 1.0).reshape(len(deflection.w_m), -1, 1)
    towards = np.where(share < 0.0, _LOW, _HIGH)
    rgb = (_REST + abs(share) * (towards - _REST)).astype(np.uint32)
    return (rgb[..., 0] << 24) | (rgb[..., 1] << 16) | (rgb[..., 2] << 8) | np.uint32(255)


def sphere_centres(
    deflection: Deflection, xi_s_m: np.ndarray, factor: float, drawn_radius_m: float
) -> np.ndarray:
    """Centres of the sphere as drawn, shape (frames, 3), from its lowest point (frames,).

    Its height is exaggerated like the plate's. During contact it rests on the plate: the
    penetration, as large as the deflection, would hide the sphere behind the plate.
    """
    i, j = deflection.contact_node
    lowest = np.maximum(xi_s_m, deflection.w_m[:, i, j])
    x, y = deflection.contact_point_m
    centres = np.empty((len(lowest), 3), np.float32)
    centres[:] = x, y, 0.0
    centres[:, 2] = factor * lowest + drawn_radius_m
    return centres
