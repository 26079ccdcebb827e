"""Forces of two laws on the same samples, as a chart."""

from pathlib import Path

import numpy as np

from hertzloop.studies.law_replay.result import ForceComparison
from hertzloop.studies.pages import pictures

_AROUND_STEPS = 100  # shown before and after the first difference


def draw_forces(found: ForceComparison, names: tuple[str, str], path: Path) -> Path:
    """Draw both forces over the whole run, and around the first difference."""
    at = found.first if found.first is not None else int(np.argmax(np.abs(found.recorded_n)))
    near = slice(max(at - _AROUND_STEPS, 0), at + _AROUND_STEPS)
    metric, axes = pictures.sheet(2, 1)
    for axis, span, scale, unit in (
        (axes[0, 0], slice(None), 1e3, "ms"),
        (axes[1, 0], near, 1e6, "us"),
    ):
        time = scale * found.step_s * np.arange(len(found.recorded_n))[span]
        for i, force in enumerate((found.recorded_n, found.other_n)):
            axis.step(time, force[span], where="post", label=names[i], **pictures.look(i))
        axis.set(xlabel=f"time ({unit})", ylabel="force (N)")
        axis.legend()
    if found.first is not None:
        axes[1, 0].axvline(1e6 * found.step_s * at, color="0.5", linewidth=0.8)
        axes[1, 0].set_title(f"around the first difference, step {at}")
    return pictures.save(metric, path)
