"""The study `law replay`: the samples of a recording, fed to another law."""

from dataclasses import dataclass

import numpy as np

from hertzloop.loop.answering import answer_samples
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.controller import build_controller
from hertzloop.scene.setup import Setup, parse


@dataclass(frozen=True)
class ForceComparison:
    """Forces (N) of every step that both know, and the first step at which they differ."""

    recorded_n: np.ndarray
    other_n: np.ndarray
    first: int | None
    step_s: float


def scene_with(recording: Recording, law: str, settings: dict[str, object]) -> Setup:
    """The recorded scene with another law, and other keys. Raises SceneError."""
    setup = parse(recording.scene_toml, recorded=True)
    fixed = {"sensors.quantity": setup.scene.sensors.quantity}
    return setup.vary({"controller.law": law, **fixed, **settings})


def replay_law(recording: Recording, setup: Setup) -> ForceComparison:
    """Feed the recorded samples to the scene's law and signal path, up to the first missing one.

    Raises SceneError, LawFault, and RecordingError if the first samples or forces are missing.
    """
    controller = build_controller(setup)
    daq, force = recording.daq, recording.force
    if not daq.samples or not force.samples:
        raise RecordingError(f"{recording.path}: the first samples or forces are missing")
    other = answer_samples(controller, daq.values).forces
    recorded = force.arrays["force_n"]
    count = min(len(other), len(recorded))
    other, recorded = other[:count].copy(), recorded[:count]
    differing = np.flatnonzero(other.view(np.int64) != recorded.view(np.int64))
    first = int(differing[0]) if len(differing) else None
    return ForceComparison(recorded, other, first, setup.run.step_s)
