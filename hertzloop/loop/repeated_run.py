"""A recorded run whose forces act again, in lock-step."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hertzloop.bus.streams import StreamFault
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import UnreadableRecording


@dataclass(frozen=True)
class RepeatedRun:
    """Forces of a recorded run.

    Attributes:
        path: The recording.
        run_id: Number of the recorded run.
        forces: Commanded force of each step, N, shape (steps,).
        held_steps: For each step, how many steps older than that step the command was that acted.
            None of a run in lock-step.
    """

    path: Path
    run_id: int
    forces: np.ndarray
    held_steps: np.ndarray | None

    @property
    def commands(self) -> np.ndarray:
        """Force that acted in each step, N, shape (steps,)."""
        if self.held_steps is None:
            return self.forces
        return np.asarray(self.forces[np.arange(len(self.forces)) - self.held_steps])

    def compare(self, forces: np.ndarray) -> None:
        """Raise StreamFault unless these forces (N, one a step) equal the recorded bits."""
        differs = np.flatnonzero(forces.view(np.int64) != self.forces.view(np.int64))
        if len(differs):
            at = int(differs[0])
            raise StreamFault(
                f"the controller's force of step {at} is {float(forces[at])!r} N, that in "
                f"{self.path} {float(self.forces[at])!r} N: this is not the same run"
            )


def repeated_run(recording: Recording) -> RepeatedRun:
    """Return the forces of a recording. Raises UnreadableRecording if it is incomplete."""
    if recording.problems:
        raise UnreadableRecording(
            f"{recording.path} cannot be repeated because it is incomplete: {recording.problems[0]}"
        )
    forces = np.array(recording.force.arrays["force_n"])
    held_steps = recording.truth.arrays.get("held_steps")
    if held_steps is not None:
        held_steps = np.array(held_steps)
        steps = np.arange(len(held_steps))
        if len(steps) != len(forces) or np.any(held_steps < 0) or np.any(held_steps > steps):
            raise UnreadableRecording(
                f"{recording.path} cannot be repeated: held_steps of stream 'truth' names forces "
                "before the run"
            )
    run_id = int(recording.metadata["run_id"], 16)
    return RepeatedRun(recording.path, run_id, forces, held_steps)
