"""Another law on the samples of a recording: what would it have done?"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hertzloop.setup import Setup, parse
from recordings.reader import Recording
from studies.pictures import look, save, sheet

_AROUND_STEPS = 100  # shown before and after the first difference


@dataclass(frozen=True)
class Comparison:
    """Forces (N) of every step that both know, and the first step at which they differ."""

    recorded_n: np.ndarray
    other_n: np.ndarray
    first: int | None
    step_s: float


def scene_with(recording: Recording, law: str, settings: dict[str, object]) -> Setup:
    """The recorded scene with another law, and other keys. Raises SceneError."""
    setup = parse(recording.scene_toml, recorded=True)
    fixed = {"sensors.quantity": setup.quantity}
    return setup.vary({"controller.law": law, **fixed, **settings})


def law_on(recording: Recording, setup: Setup) -> Comparison:
    """Feed the recorded samples to the scene's law and line. Raises SceneError, LawFault."""
    controller = setup.start_controller()
    other = controller.process(recording.daq_values).forces
    recorded = recording.force.arrays.get("force_n", np.empty(0))
    count = min(len(other), len(recorded))
    other, recorded = other[:count].copy(), recorded[:count]
    differing = np.flatnonzero(other.view(np.int64) != recorded.view(np.int64))
    first = int(differing[0]) if len(differing) else None
    return Comparison(recorded, other, first, setup.step_s)


def draw(found: Comparison, names: tuple[str, str], path: Path) -> Path:
    """Both forces over the whole run, and around the first difference."""
    at = found.first if found.first is not None else int(np.argmax(np.abs(found.recorded_n)))
    near = slice(max(at - _AROUND_STEPS, 0), at + _AROUND_STEPS)
    figure, axes = sheet(2, 1)
    for axis, span, scale, unit in (
        (axes[0, 0], slice(None), 1e3, "ms"),
        (axes[1, 0], near, 1e6, "us"),
    ):
        time = scale * found.step_s * np.arange(len(found.recorded_n))[span]
        for i, force in enumerate((found.recorded_n, found.other_n)):
            axis.step(time, force[span], where="post", label=names[i], **look(i))
        axis.set(xlabel=f"time ({unit})", ylabel="force (N)")
        axis.legend()
    if found.first is not None:
        axes[1, 0].axvline(1e6 * found.step_s * at, color="0.5", linewidth=0.8)
        axes[1, 0].set_title(f"around the first difference, step {at}")
    return save(figure, path)
