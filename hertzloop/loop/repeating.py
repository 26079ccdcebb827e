"""A recorded run once more, in lock-step: the same commands act in the same steps."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bus.streams import StreamFault
from recordings.reader import Recording
from recordings.writer import RecordingError


@dataclass(frozen=True)
class Repeat:
    """What is repeated: the run's number, its forces (N, one a step), and by how many steps the one
    that acted in each was too old; None of a run in lock-step."""

    path: Path
    run_id: int
    forces: np.ndarray
    held: np.ndarray | None

    @property
    def commands(self) -> np.ndarray:
        """What acted in each step, N."""
        if self.held is None:
            return self.forces
        return np.asarray(self.forces[np.arange(len(self.forces)) - self.held])

    def compare(self, forces: np.ndarray) -> None:
        """Raise StreamFault unless the controller's forces are the recorded ones, bit for bit."""
        differs = np.flatnonzero(forces.view(np.int64) != self.forces.view(np.int64))
        if len(differs):
            at = int(differs[0])
            raise StreamFault(
                f"the controller's force of step {at} is {float(forces[at])!r} N, that in "
                f"{self.path} {float(self.forces[at])!r} N: this is not the same run"
            )


def repeat_of(recording: Recording) -> Repeat:
    """What is to be repeated of a recording. Raises RecordingError if it is not whole."""
    if recording.problems:
        raise RecordingError(
            f"{recording.path} cannot be repeated, it is not whole: {recording.problems[0]}"
        )
    forces = np.array(recording.force.arrays["force_n"])
    held = recording.truth.arrays.get("held_steps")
    if held is not None:
        held = np.array(held)
        if len(held) != len(forces) or np.any(held < 0) or np.any(held > np.arange(len(held))):
            raise RecordingError(
                f"{recording.path} cannot be repeated: held_steps of stream 'truth' names forces "
                "before the run"
            )
    return Repeat(recording.path, int(recording.metadata["run_id"], 16), forces, held)
