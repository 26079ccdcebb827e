"""Measured and modelled responses of a measured structure, as a picture."""

from pathlib import Path

import numpy as np

from hertzloop.fitting.modes.measured_modes import MeasuredModes
from hertzloop.studies.pages import pictures


def draw(found: MeasuredModes, path: Path) -> None:
    """Draw measured and modelled responses of the data that were held out. Raises NotWritten."""
    metric, axes = pictures.sheet(len(found.held_out), 1)
    for one, ax in zip(found.held_out, axes[:, 0], strict=True):
        of_lines = np.iscomplexobj(one.measured)
        for i, what in enumerate(("measured", "modelled")):
            values = getattr(one, what)
            x, y = (one.x, np.abs(values)) if of_lines else (1e3 * one.x, values)
            ax.plot(x, y, label=what, **pictures.look(i))
        ax.set_yscale("log" if of_lines else "linear")
        ax.set_title(f"{one.name}: error {100 * one.rms:.1f} %, {one.modes} modes")
        ax.set_xlabel("frequency, Hz" if of_lines else "time after the hit, ms")
        ax.set_ylabel("response, SI units")
        ax.legend()
    pictures.save(metric, path)
