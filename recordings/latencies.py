"""Latencies of a paced run, by sample, from what its recording says of late forces.

In a paced run step k acts under the force of step k - `held_steps`. The command of sample i is
meant to act from a step of its own on. The first step whose force is at least as new is the one
from which it did act. A run in lock-step with these latencies therefore has the forces of the
paced run, step by step.
"""

import tomllib

import numpy as np

from hertzloop.recordings.recording import Recording


def latencies_of(recording: Recording) -> np.ndarray:
    """Return the latency of every sample beyond the one step that cannot be avoided.

    Args:
        recording: A paced run, or its repetition in lock-step.

    Returns:
        Latencies, us, shape (samples,). A command that did not act before the end of the run has
        the smallest latency with which it does not, or that of the scene if that is larger.

    Raises:
        ValueError: the run was in lock-step, so that its latencies are those of its scene.
    """
    if "held_steps" not in recording.truth.arrays:
        raise ValueError(
            f"{recording.path}: is a run in lock-step, which has no latencies of its own. Record "
            "one with hertzloop run --pace"
        )
    held = recording.truth.arrays["held_steps"].astype(np.int64)
    scene = tomllib.loads(recording.scene_toml)
    every, step_ns = scene["sensors"]["every_steps"], scene["run"]["step_ns"]
    control = scene["controller"]
    asked = round(control["latency_us"] * 1000 / step_ns)
    # Newest force that acted up to each step, as the step that it belongs to.
    newest = np.maximum.accumulate(np.arange(held.size) - held)
    sampled = np.arange(0, held.size, every)
    acts = np.searchsorted(newest, sampled + 1 + asked)
    late = np.maximum(acts - sampled - 1, asked)  # `acts` is the end of the run at most
    return np.asarray(late * (step_ns / 1000.0))
