"""The plate, the sphere, the actuator and the colour scale in three dimensions."""

import math
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
import rerun as rr

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
_LOW, _REST, _HIGH = (np.array(c) for c in ((38, 98, 214), (196, 204, 214), (226, 84, 44)))
_SHADES = 512  # to either side of rest: finer than a colour can be told
_LIGHTS = 128  # levels of light, from none to all of it
# The viewer's lamps (rerun-sdk 0.41): direction to each and brightness; light from everywhere.
_LAMPS = (((1.0, 2.0, 3.0), 1.0), ((-1.0, -3.0, -5.0), 0.5))
_AMBIENT = 0.2
_EXACT_SHARE = 1e-3  # error of a surface as drawn, of the plate's shorter side: below one pixel


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


def enough_lines(along_m: np.ndarray, heights: np.ndarray, within_m: float) -> np.ndarray:
    """Ascending positions along an axis (n,), both ends among them, between which straight lines
    keep within `within_m` of the heights (frames, n, m)."""
    kept, last = [0], len(along_m) - 1
    while (a := kept[-1]) < last:
        b = a + 1
        while b < last:
            share = ((along_m[a + 1 : b + 1] - along_m[a]) / (along_m[b + 1] - along_m[a]))[:, None]
            start, end = heights[:, a, None], heights[:, b + 1, None]
            error = abs(start + share * (end - start) - heights[:, a + 1 : b + 1]).max(initial=0.0)
            if not error <= within_m:
                break
            b += 1
        kept.append(b)
    return np.array(kept)


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


def light(normals: np.ndarray) -> np.ndarray:
    """Share of its colour that a surface shows in the viewer's light, by normals (..., 3)."""
    found = np.full(normals.shape[:-1], _AMBIENT, np.float32)
    for towards, brightness in _LAMPS:
        unit = np.array(towards, np.float32) / np.float32(np.linalg.norm(towards))
        found += np.float32(brightness) * np.clip(normals @ unit, 0.0, 1.0)
    return np.asarray(np.clip(found, 0.0, 1.0))


def colours(deflection: Deflection, drawn: Scale) -> np.ndarray:
    """Blue below and red above rest, darker where the surface turns away from the light, shape
    (frames, nodes), 0xRRGGBBAA."""
    share = deflection.w_m.reshape(len(deflection.w_m), -1) / drawn.full_colour_m
    return colour_of(share, light(normals(deflection, drawn)))


def colour_of(share: np.ndarray, lit: np.ndarray | float = 1.0) -> np.ndarray:
    """Colours of deflections in shares of that in full colour, `lit` by so much of the light (both
    of the same shape, or one number), 0xRRGGBBAA."""
    shade = np.rint(_SHADES * np.clip(share, -1.0, 1.0)).astype(np.int16) + np.int16(_SHADES)
    return np.asarray(_shades()[shade, np.rint(_LIGHTS * np.asarray(lit)).astype(np.int16)])


@cache
def _shades() -> np.ndarray:
    """The colours of the shares -1 to 1 and of no light to all of it, each in equal steps,
    (2 _SHADES + 1, _LIGHTS + 1), 0xRRGGBBAA."""
    share = np.linspace(-1.0, 1.0, 2 * _SHADES + 1)[:, None]
    towards = np.where(share < 0.0, _LOW, _HIGH)
    # Light multiplies what a colour stands for: its number to the power of 2.2.
    lit = np.linspace(0.0, 1.0, _LIGHTS + 1)[:, None] ** (1.0 / 2.2)
    rgb = (_REST + abs(share) * (towards - _REST))[:, None] * lit
    red, green, blue = rgb.astype(np.uint32).transpose(2, 0, 1)
    return (red << 24) | (green << 16) | (blue << 8) | np.uint32(255)


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


_STEEL, _TOUCHING = 0xC4CCD6FF, 0xFFB020FF
_ACTUATOR = (74, 222, 128)
_WORDS = (200, 206, 216)
_BAR_PIECES = 40
_ARROW_SHARE = 0.16  # length of the largest force, of the plate's shorter side


def times(time_ns: np.ndarray) -> rr.TimeColumn:
    """Simulated times, exact to the nanosecond."""
    return rr.TimeColumn(TIMELINE, duration=time_ns.astype("timedelta64[ns]"))


def send_plate(stream: rr.RecordingStream, deflection: Deflection, drawn: Scale) -> None:
    """The deflecting plate with its rim at rest, and what its colours mean."""
    (x0, y0), (x1, y1) = deflection.low_m, (deflection.x_m[-1], deflection.y_m[-1])
    edge = [(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0), (x0, y0, 0)]
    stream.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("scene/edge", rr.LineStrips3D([edge], colors=(120, 130, 145)), static=True)
    # What each frame repeats decides how large the file is: only as many nodes as the surface
    # needs, round heights, and the light within the colours, since normals take more than both.
    within_m = _EXACT_SHARE * min(deflection.size_m)
    heights = _heights(deflection, drawn).astype(np.float32)
    i = enough_lines(deflection.x_m, heights, within_m)
    j = enough_lines(deflection.y_m, heights[:, i].transpose(0, 2, 1), within_m)
    w = deflection.w_m[:, i][:, :, j]
    coarse = replace(deflection, x_m=deflection.x_m[i], y_m=deflection.y_m[j], w_m=w)
    places, shape = vertices(coarse, drawn), deflection.w_m.shape
    step = 2.0 ** math.floor(math.log2(within_m / 2.0))
    places[..., 2] = np.rint(places[..., 2] / step) * step
    looks = rr.Mesh3D.from_fields(
        triangle_indices=triangles(coarse), vertex_normals=np.zeros_like(places[0])
    )
    stream.log("scene/plate", looks, static=True)
    columns = rr.Mesh3D.columns(
        vertex_positions=places.reshape(-1, 3),
        vertex_colors=colours(deflection, drawn).reshape(shape)[:, i][:, :, j].ravel(),
    )
    stream.send_columns(
        "scene/plate",
        [times(deflection.times_ns)],
        columns.partition([len(i) * len(j)] * len(places)),
    )
    if not drawn.flat:
        _send_colour_scale(stream, deflection, drawn)


def _send_colour_scale(stream: rr.RecordingStream, deflection: Deflection, drawn: Scale) -> None:
    """A bar beside the plate, from the deflection that is all blue to the one that is all red."""
    y0, (x, y) = deflection.low_m[1], deflection.size_m
    at = float(deflection.x_m[-1]) + 0.09 * min(x, y)
    ends = y0 + np.linspace(0.1 * y, 0.9 * y, _BAR_PIECES + 1)
    pieces = [[(at, a, 0.0), (at, b, 0.0)] for a, b in pairwise(ends)]
    colours = colour_of(np.linspace(-1.0, 1.0, _BAR_PIECES))
    bar = rr.LineStrips3D(pieces, colors=colours, radii=0.012 * min(x, y))
    stream.log("scene/colours", bar, static=True)
    value = with_unit(drawn.full_colour_m, "m")
    words = [f"-{value} and below", "0 m", f"+{value} and above"]
    # A word is centred at its place: the farther ones need more room beside the bar.
    beside = ((0.1, 0.13), (0.5, 0.1), (0.9, 0.22))
    places = [(at + off * min(x, y), y0 + share * y, 0.0) for share, off in beside]
    stream.log(
        "scene/colours/values",
        rr.Points3D(places, labels=words, colors=_WORDS, radii=1e-4, show_labels=True),
        static=True,
    )


def with_unit(value: float, unit: str) -> str:
    """A length or force with a prefix: 2e-6, "m" is "2 µm"."""
    for prefix, size in (("G", 1e9), ("M", 1e6), ("k", 1e3), ("", 1.0), ("m", 1e-3), ("µ", 1e-6)):
        if abs(value) >= size:
            return f"{value / size:.3g} {prefix}{unit}"
    return f"{value / 1e-9:.3g} n{unit}" if value else f"0 {unit}"


def send_sphere(
    stream: rr.RecordingStream,
    xi_s_m: np.ndarray,
    xi_m: np.ndarray,
    deflection: Deflection,
    drawn: Scale,
) -> None:
    """The sphere, in another colour while it touches, by its lowest point and the gap (frames,)."""
    centres = sphere_centres(deflection, xi_s_m, drawn)
    colours = np.where(xi_m < 0.0, _TOUCHING, _STEEL).astype(np.uint32)
    shape = rr.Ellipsoids3D.from_fields(
        half_sizes=[(drawn.sphere_radius_m,) * 3], fill_mode="solid"
    )
    stream.log("scene/sphere", shape, static=True)
    columns = rr.Ellipsoids3D.columns(centers=centres, colors=colours)
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
    side, y0 = min(deflection.size_m), deflection.low_m[1]
    x, y = point_m
    reach = 1.5 * drawn.sphere_radius_m
    above = 0.012 * side
    angles = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = np.stack(
        [x + reach * np.cos(angles), y + reach * np.sin(angles), np.full(49, above)], axis=1
    )
    lines = rr.LineStrips3D([ring], colors=_ACTUATOR, radii=0.004 * side)
    stream.log("scene/actuator", lines, static=True)
    word = "actuator"
    if full_force_n > 0.0:
        word = f"actuator, full arrow {with_unit(full_force_n, 'N')}"
    # The name is before the plate, where it hides nothing.
    place = (x, y0 - 0.09 * side, 0.0)
    name = rr.Points3D([place], labels=[word], colors=_ACTUATOR, radii=1e-4, show_labels=True)
    stream.log("scene/actuator/name", name, static=True)
    leader = [(x, y - reach, above), (x, y0, above), place]
    lines = rr.LineStrips3D([leader], colors=_ACTUATOR, radii=0.0015 * side)
    stream.log("scene/actuator/leader", lines, static=True)
    if not full_force_n > 0.0:
        return
    force = np.nan_to_num(force_n / full_force_n)
    vectors = np.zeros((len(force), 3), np.float32)
    vectors[:, 2] = np.clip(force, -1.0, 1.0) * _ARROW_SHARE * side
    looks = rr.Arrows3D.from_fields(
        origins=[(x - reach, y, above)], colors=[_ACTUATOR], radii=[0.008 * side]
    )
    stream.log("scene/actuator/force", looks, static=True)
    columns = rr.Arrows3D.columns(vectors=vectors)
    stream.send_columns("scene/actuator/force", [times(deflection.times_ns)], columns)
