"""The plate, the sphere, the actuator and the colour scale in three dimensions."""

from itertools import pairwise

import numpy as np
import rerun as rr

from recordings.replay import plate_mesh
from recordings.replay.blueprint import TIMELINE
from recordings.replay.data import Deflection

_STEEL, _TOUCHING = 0xC4CCD6FF, 0xFFB020FF
_ACTUATOR = (74, 222, 128)
_WORDS = (200, 206, 216)
_BAR_PIECES = 40
_ARROW_SHARE = 0.16  # length of the largest force, of the plate's shorter side


def times(time_ns: np.ndarray) -> rr.TimeColumn:
    """Simulated times, exact to the nanosecond."""
    return rr.TimeColumn(TIMELINE, duration=time_ns.astype("timedelta64[ns]"))


def send_plate(stream: rr.RecordingStream, deflection: Deflection, drawn: plate_mesh.Scale) -> None:
    """The deflecting plate with its rim at rest, and what its colours mean."""
    frames, nodes = len(deflection.times_ns), deflection.w_m[0].size
    (x0, y0), (x1, y1) = deflection.low_m, (deflection.x_m[-1], deflection.y_m[-1])
    edge = [(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0), (x0, y0, 0)]
    stream.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("scene/edge", rr.LineStrips3D([edge], colors=(120, 130, 145)), static=True)
    indices = rr.Mesh3D.from_fields(triangle_indices=plate_mesh.triangles(deflection))
    stream.log("scene/plate", indices, static=True)
    columns = rr.Mesh3D.columns(
        vertex_positions=plate_mesh.vertices(deflection, drawn).reshape(-1, 3),
        vertex_normals=plate_mesh.normals(deflection, drawn).reshape(-1, 3),
        vertex_colors=plate_mesh.colours(deflection, drawn).ravel(),
    )
    stream.send_columns(
        "scene/plate", [times(deflection.times_ns)], columns.partition([nodes] * frames)
    )
    if not drawn.flat:
        _send_colour_scale(stream, deflection, drawn)


def _send_colour_scale(
    stream: rr.RecordingStream, deflection: Deflection, drawn: plate_mesh.Scale
) -> None:
    """A bar beside the plate, from the deflection that is all blue to the one that is all red."""
    y0, (x, y) = deflection.low_m[1], deflection.size_m
    at = float(deflection.x_m[-1]) + 0.09 * min(x, y)
    ends = y0 + np.linspace(0.1 * y, 0.9 * y, _BAR_PIECES + 1)
    pieces = [[(at, a, 0.0), (at, b, 0.0)] for a, b in pairwise(ends)]
    colours = plate_mesh.colour_of(np.linspace(-1.0, 1.0, _BAR_PIECES))
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
    drawn: plate_mesh.Scale,
) -> None:
    """The sphere, in another colour while it touches, by its lowest point and the gap (frames,)."""
    centres = plate_mesh.sphere_centres(deflection, xi_s_m, drawn)
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
    drawn: plate_mesh.Scale,
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
