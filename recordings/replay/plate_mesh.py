"""The deflecting plate and the sphere as meshes of a 3D view, drawn larger than life."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from recordings.replay.data import Deflection, Span

_DRAWN_SHARE = 0.12  # largest deflection as drawn, of the plate's shorter side
_SPHERE_SHARE = 0.05  # smallest radius as drawn
_FULL_COLOUR_SHARE = 0.4  # of the largest deflection: waves far from the contact show, too
_LATER_SHARE = 1 / 3  # of larger deflections after the first impact
_RUNAWAY = 100.0  # times as large as at the first impact: a run that explodes
_MOST_SHARE = 0.3  # largest deflection as drawn; what is beyond is cut
_HIGHEST_SHARE = 0.35  # of the sphere as drawn: it stays in the picture
_FLAT_M = 1e-15  # less than this is no deflection
_LOW, _REST, _HIGH = (np.array(c) for c in ((38, 98, 214), (196, 204, 214), (226, 84, 44)))
_SHADES = 512  # to either side of rest: finer than a colour can be told


@dataclass(frozen=True)
class Scale:
    """How things are drawn: heights times `heights`, up to `highest_m` as drawn; deflections from
    `full_colour_m` on in full colour, the sphere with `sphere_radius_m` instead of its own radius
    and never more than `sphere_highest_m` above the plate."""

    heights: float
    full_colour_m: float
    sphere_radius_m: float
    highest_m: float = math.inf
    sphere_highest_m: float = math.inf

    @property
    def flat(self) -> bool:
        """Whether there is no deflection to be drawn."""
        return self.full_colour_m <= _FLAT_M

    @property
    def in_words(self) -> str:
        """Such as "2,000 times"."""
        return f"{self.heights:,.0f} times" if self.heights >= 1 else f"{self.heights:g} times"


def scale(deflection: Deflection, span_ns: Span, radius_m: float) -> Scale:
    """A scale by which the deflections within a span of time show, and larger ones later unless
    they explode.

    Factor and full colour are 1, 2 or 5 times a power of ten; a sphere too small to see is drawn
    larger.
    """
    largest = np.nan_to_num(abs(deflection.w_m).max(axis=(1, 2), initial=0.0))
    within = (deflection.times_ns >= span_ns[0]) & (deflection.times_ns <= span_ns[1])
    first, ever = largest[within].max(initial=0.0), largest.max(initial=0.0)
    runs_away = first >= _FLAT_M and ever > _RUNAWAY * first
    reference = first if runs_away else max(first, _LATER_SHARE * ever)
    side = min(deflection.size_m)
    radius = max(radius_m, _SPHERE_SHARE * side)
    limits = (_MOST_SHARE * side, _HIGHEST_SHARE * side)
    if reference < _FLAT_M:
        return Scale(1.0, _FLAT_M, radius, *limits)
    factor = round_below(_DRAWN_SHARE * side / reference)
    return Scale(factor, round_below(_FULL_COLOUR_SHARE * reference), radius, *limits)


def round_below(wanted: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return float(power * max(step for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9)))


def round_above(wanted: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that is not below."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return float(power * min(step for step in (1, 2, 5, 10) if step * power >= wanted * (1 - 1e-9)))


def triangles(deflection: Deflection) -> np.ndarray:
    """Vertex indices of the triangles, shape (triangles, 3); vertex (i, j) is i * ny + j."""
    nx, ny = len(deflection.x_m), len(deflection.y_m)
    corner = (np.arange(nx - 1)[:, None] * ny + np.arange(ny - 1)).ravel()
    lower = np.stack([corner, corner + ny, corner + 1], axis=1)
    upper = np.stack([corner + 1, corner + ny, corner + ny + 1], axis=1)
    return np.concatenate([lower, upper]).astype(np.uint32)


def vertices(deflection: Deflection, drawn: Scale) -> np.ndarray:
    """Positions with the heights multiplied, shape (frames, nodes, 3), m."""
    frames, nx, ny = deflection.w_m.shape
    found = np.empty((frames, nx, ny, 3), np.float32)
    found[..., 0] = deflection.x_m[:, None]
    found[..., 1] = deflection.y_m
    found[..., 2] = _heights(deflection, drawn)
    return found.reshape(frames, nx * ny, 3)


def _heights(deflection: Deflection, drawn: Scale) -> np.ndarray:
    """Deflections as drawn, (frames, nx, ny), m."""
    return np.asarray(np.clip(drawn.heights * deflection.w_m, -drawn.highest_m, drawn.highest_m))


def normals(deflection: Deflection, drawn: Scale) -> np.ndarray:
    """Unit normals of the surface as drawn, shape (frames, nodes, 3)."""
    w = _heights(deflection, drawn).astype(np.float32)
    x, y = deflection.x_m.astype(np.float32), deflection.y_m.astype(np.float32)
    slope_x, slope_y = np.gradient(w, x, y, axis=(1, 2))
    up = 1.0 / np.sqrt(slope_x * slope_x + slope_y * slope_y + np.float32(1.0))
    found = np.empty((*w.shape, 3), np.float32)
    np.multiply(slope_x, -up, out=found[..., 0])
    np.multiply(slope_y, -up, out=found[..., 1])
    found[..., 2] = up
    return found.reshape(len(w), -1, 3)


def colours(deflection: Deflection, drawn: Scale) -> np.ndarray:
    """Blue below and red above rest, shape (frames, nodes), 0xRRGGBBAA."""
    return colour_of(deflection.w_m.reshape(len(deflection.w_m), -1) / drawn.full_colour_m)


def colour_of(share: np.ndarray) -> np.ndarray:
    """Colours of deflections in shares of that in full colour, same shape, 0xRRGGBBAA."""
    shade = np.rint(_SHADES * np.clip(share, -1.0, 1.0)).astype(np.int16) + np.int16(_SHADES)
    return np.asarray(_shades()[shade])


@cache
def _shades() -> np.ndarray:
    """The colours of the shares -1 to 1 in equal steps, (2 _SHADES + 1,), 0xRRGGBBAA."""
    share = np.linspace(-1.0, 1.0, 2 * _SHADES + 1)[:, None]
    towards = np.where(share < 0.0, _LOW, _HIGH)
    rgb = (_REST + abs(share) * (towards - _REST)).astype(np.uint32)
    return (rgb[..., 0] << 24) | (rgb[..., 1] << 16) | (rgb[..., 2] << 8) | np.uint32(255)


def sphere_centres(deflection: Deflection, xi_s_m: np.ndarray, drawn: Scale) -> np.ndarray:
    """Centres of the sphere as drawn, shape (frames, 3), from its lowest point (frames,).

    Its height above the plate is exaggerated like the plate's near it, and less the higher it is,
    so that it stays in the picture. During contact it rests on the plate: the penetration, as
    large as the deflection, would hide the sphere behind the plate.
    """
    i, j = deflection.contact_node
    plate = _heights(deflection, drawn)[:, i, j]
    above = np.maximum(drawn.heights * (xi_s_m - deflection.w_m[:, i, j]), 0.0)
    if math.isfinite(drawn.sphere_highest_m):
        above = drawn.sphere_highest_m * np.tanh(above / drawn.sphere_highest_m)
    centres = np.empty((len(above), 3), np.float32)
    centres[:, :2] = deflection.contact_point_m
    centres[:, 2] = plate + above + drawn.sphere_radius_m
    return centres
