"""The animation of a report: deflections of the plate around the first contact."""

import base64
from typing import Any

import numpy as np

from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.recordings.replay.replay_data import ReplayData
from hertzloop.recordings.replay.scene3d import with_unit

_FRAMES = 240
_LEVELS = 127  # of a deflection, each way


def animation_of(shown: ReplayData) -> dict[str, Any]:
    """Return what a canvas needs: deflections around the first contact, in 127 levels each way."""
    plate: Deflection = shown.deflection
    low, high = shown.when.selection_ns
    inside = np.flatnonzero((plate.times_ns >= low) & (plate.times_ns <= high))
    if len(inside) < 2:
        inside = np.arange(len(plate.times_ns))
    inside = inside[np.unique(np.linspace(0, len(inside) - 1, _FRAMES).astype(int))]
    full = shown.drawn.full_colour_m
    levels = np.clip(np.round(np.nan_to_num(plate.w_m[inside]) / full * _LEVELS), -127, 127)
    # Rows of a picture go down, y goes up.
    frames = np.ascontiguousarray(levels.astype(np.int8).transpose(0, 2, 1)[:, ::-1])
    gap_m, force_n = (shown.at_frames[name][inside] for name in ("xi_m", "f_a_n"))
    corner, size = plate.low_m, plate.size_m

    def place(point: tuple[float, float]) -> list[float]:
        return [(point[0] - corner[0]) / size[0], 1.0 - (point[1] - corner[1]) / size[1]]

    actuator = shown.labels.actuator_m
    return {
        "frames": base64.b64encode(frames.tobytes()).decode(),
        "count": len(inside),
        "nx": len(plate.x_m),
        "ny": len(plate.y_m),
        "x": ((plate.x_m - corner[0]) / size[0]).tolist(),
        "y": (1.0 - (plate.y_m[::-1] - corner[1]) / size[1]).tolist(),
        "aspect": size[1] / size[0],
        "size": [f"{1e3 * side:g} mm" for side in size],
        "times": [f"{1e-6 * t:z.4f} ms" for t in plate.times_ns[inside].tolist()],
        "touching": (gap_m < 0.0).tolist(),
        "force": [with_unit(float(f), "N") for f in np.nan_to_num(force_n)],
        "contact": place(plate.contact_point_m),
        "actuator": place(actuator) if actuator else None,
        "full": "" if shown.drawn.flat else with_unit(full, "m"),
    }
