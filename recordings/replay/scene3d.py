"""The plate, the sphere and the actuator in three dimensions, in the viewer's own light."""

import math
from dataclasses import dataclass

import numpy as np
import rerun as rr

from hertzloop.common.readable import quantity
from hertzloop.recordings.replay.blueprint import TIMELINE
from hertzloop.recordings.replay.contacts import Span
from hertzloop.recordings.replay.deflection import Deflection

_DRAWN_SHARE = 0.12  # largest deflection as drawn, of the plate's shorter side
_SPHERE_SHARE = 0.05  # smallest radius as drawn
_FULL_COLOUR_SHARE = 0.4  # of the largest deflection: waves far from the contact show, too
_LATER_SHARE = 1 / 3  # of larger deflections after the first impact
_RUNAWAY = 100.0  # times as large as at the first impact: a run that explodes
_MOST_SHARE = 0.3  # largest deflection as drawn; what is beyond is cut
_HIGHEST_SHARE = 0.35  # of the sphere as drawn: it stays in the picture
_FLAT_M = 1e-15  # less than this is no deflection
_EXACT_SHARE = 5e-4  # error of a surface as drawn, of the plate's shorter side: below one pixel
_NORMAL_STEP = 1 / 64  # of a unit normal: finer than its light can be told
_LOW, _REST, _HIGH = (np.array(c) for c in ((38, 98, 214), (196, 204, 214), (226, 84, 44)))
_STEEL, _TOUCHING = 0xC4CCD6FF, 0xFFB020FF
_ACTUATOR = (74, 222, 128)
_ARROW_SHARE = 0.16  # length of the largest force, of the plate's shorter side


@dataclass(frozen=True)
class Scale:
    """How things are drawn.

    Attributes:
        heights: Factor of heights.
        full_colour_m: Deflection from which on the colour is full.
        sphere_radius_m: Radius of the sphere as drawn.
        highest_m: Largest deflection as drawn.
        sphere_highest_m: Largest height of the sphere above the plate as drawn.
    """

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
    radius = max(_SPHERE_SHARE * side, radius_m)  # nan of a soft tip is not larger
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


def with_unit(value: float, unit: str) -> str:
    """A length or force with a prefix: 2e-6, "m" is "2 µm"."""
    return quantity(value, unit).replace(" u", " µ")


def times(time_ns: np.ndarray) -> rr.TimeColumn:
    """Simulated times, exact to the nanosecond."""
    return rr.TimeColumn(TIMELINE, duration=time_ns.astype("timedelta64[ns]"))


def heights(deflection: Deflection, drawn: Scale) -> np.ndarray:
    """Deflections as drawn, (frames, nx, ny), m."""
    return np.asarray(np.clip(drawn.heights * deflection.w_m, -drawn.highest_m, drawn.highest_m))


def _triangles(deflection: Deflection) -> np.ndarray:
    """Vertex indices of the triangles, shape (triangles, 3); vertex (i, j) is i * ny + j."""
    nx, ny = len(deflection.x_m), len(deflection.y_m)
    corner = (np.arange(nx - 1)[:, None] * ny + np.arange(ny - 1)).ravel()
    lower = np.stack([corner, corner + ny, corner + 1], axis=1)
    upper = np.stack([corner + 1, corner + ny, corner + ny + 1], axis=1)
    return np.concatenate([lower, upper]).astype(np.uint32)


def _vertices(deflection: Deflection, drawn: Scale) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m) and unit normals of the surface as drawn, each of shape (frames, nx, ny, 3)."""
    w = heights(deflection, drawn).astype(np.float32)
    places, normals = np.empty((2, *w.shape, 3), np.float32)
    places[..., 0], places[..., 1], places[..., 2] = deflection.x_m[:, None], deflection.y_m, w
    slope_x, slope_y = np.gradient(w, deflection.x_m, deflection.y_m, axis=(1, 2))
    normals[..., 0], normals[..., 1], normals[..., 2] = -slope_x, -slope_y, 1.0
    return places, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _rounded(values: np.ndarray, step: float) -> np.ndarray:
    """Values to the nearest multiple of a power of two that is not above a step."""
    step = 2.0 ** math.floor(math.log2(step))
    return np.rint(values / np.float32(step)) * np.float32(step)


def _colours(deflection: Deflection, drawn: Scale) -> np.ndarray:
    """Blue below and red above rest, shape (frames, nx, ny), 0xRRGGBBAA."""
    share = np.clip(deflection.w_m / drawn.full_colour_m, -1.0, 1.0)[..., None]
    rgb = _REST + abs(share) * (np.where(share < 0.0, _LOW, _HIGH) - _REST)
    red, green, blue = np.moveaxis(rgb.astype(np.uint32), -1, 0)
    return np.asarray((red << 24) | (green << 16) | (blue << 8) | np.uint32(255))


def send_plate(stream: rr.RecordingStream, deflection: Deflection, drawn: Scale) -> None:
    """The deflecting plate with its rim at rest."""
    (x0, y0), (x1, y1) = deflection.low_m, (deflection.x_m[-1], deflection.y_m[-1])
    edge = [(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0), (x0, y0, 0)]
    stream.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("scene/edge", rr.LineStrips3D([edge], colors=(120, 130, 145)), static=True)
    places, normals = _vertices(deflection, drawn)
    # Round numbers are packed smaller.
    places[..., 2] = _rounded(places[..., 2], _EXACT_SHARE * min(deflection.size_m))
    looks = rr.Mesh3D.from_fields(triangle_indices=_triangles(deflection))
    stream.log("scene/plate", looks, static=True)
    columns = rr.Mesh3D.columns(
        vertex_positions=places.reshape(-1, 3),
        vertex_normals=_rounded(normals, _NORMAL_STEP).reshape(-1, 3),
        vertex_colors=_colours(deflection, drawn).ravel(),
    )
    frames = [deflection.w_m[0].size] * len(places)
    stream.send_columns("scene/plate", [times(deflection.times_ns)], columns.partition(frames))


def sphere_centres(deflection: Deflection, xi_s_m: np.ndarray, drawn: Scale) -> np.ndarray:
    """Centres of the sphere as drawn, shape (frames, 3), from its lowest point (frames,).

    Its height above the plate is exaggerated like the plate's near it, and less the higher it is,
    so that it stays in the picture. During contact it rests on the plate: the penetration, as
    large as the deflection, would hide the sphere behind the plate.
    """
    i, j = deflection.contact_node
    above = np.maximum(drawn.heights * (xi_s_m - deflection.w_m[:, i, j]), 0.0)
    if math.isfinite(drawn.sphere_highest_m):
        above = drawn.sphere_highest_m * np.tanh(above / drawn.sphere_highest_m)
    centres = np.empty((len(above), 3), np.float32)
    centres[:, :2] = deflection.contact_point_m
    centres[:, 2] = heights(deflection, drawn)[:, i, j] + above + drawn.sphere_radius_m
    return centres


def send_sphere(
    stream: rr.RecordingStream,
    xi_s_m: np.ndarray,
    xi_m: np.ndarray,
    deflection: Deflection,
    drawn: Scale,
) -> None:
    """The sphere, in another colour while it touches, by its lowest point and the gap (frames,)."""
    shape = rr.Ellipsoids3D.from_fields(
        half_sizes=[(drawn.sphere_radius_m,) * 3], fill_mode="solid"
    )
    stream.log("scene/sphere", shape, static=True)
    columns = rr.Ellipsoids3D.columns(
        centers=sphere_centres(deflection, xi_s_m, drawn),
        colors=np.where(xi_m < 0.0, _TOUCHING, _STEEL).astype(np.uint32),
    )
    stream.send_columns("scene/sphere", [times(deflection.times_ns)], columns)


def send_actuator(
    stream: rr.RecordingStream,
    force_n: np.ndarray,
    deflection: Deflection,
    point_m: tuple[float, float],
    drawn: Scale,
    full_force_n: float,
) -> None:
    """A ring where the actuator pushes, and its force (frames,) as an arrow at the ring's side; an
    arrow of full length is `full_force_n`."""
    side, (x, y), y0 = min(deflection.size_m), point_m, deflection.low_m[1]
    reach, above = 1.5 * drawn.sphere_radius_m, 0.012 * side
    # The name is before the plate, where it hides nothing.
    place = (x, y0 - 0.09 * side, 0.0)
    angles = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = [(x + reach * np.cos(a), y + reach * np.sin(a), above) for a in angles]
    leader = [(x, y - reach, above), (x, y0, above), place]
    lines = rr.LineStrips3D([ring, leader], colors=_ACTUATOR, radii=[0.004 * side, 0.0015 * side])
    stream.log("scene/actuator", lines, static=True)
    word = f"actuator, full arrow {with_unit(full_force_n, 'N')}" if full_force_n else "actuator"
    name = rr.Points3D([place], labels=[word], colors=_ACTUATOR, radii=1e-4, show_labels=True)
    stream.log("scene/actuator/name", name, static=True)
    if not full_force_n:
        return
    vectors = np.zeros((len(force_n), 3), np.float32)
    share = np.clip(np.nan_to_num(force_n / full_force_n), -1.0, 1.0)
    vectors[:, 2] = _ARROW_SHARE * side * share
    looks = rr.Arrows3D.from_fields(
        origins=[(x - reach, y, above)], colors=[_ACTUATOR], radii=[0.008 * side]
    )
    stream.log("scene/actuator/force", looks, static=True)
    columns = rr.Arrows3D.columns(vectors=vectors)
    stream.send_columns("scene/actuator/force", [times(deflection.times_ns)], columns)
