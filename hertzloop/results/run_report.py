"""A recorded run with everything that is reported of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hertzloop.bus.messages_pb2 import EnergyBalance
from hertzloop.recordings.recording import Recording
from hertzloop.results import verdict as verdicts
from hertzloop.results.verification import Verification
from hertzloop.scene.setup import Setup


@dataclass(frozen=True)
class RunReport:
    """A recorded run with its assessment.

    Attributes:
        setup: the setup of the run.
        recording: the recording, as read after the run.
        assessed: metrics of the run, and their assessment.
        balance: energy and momentum balance at the end of the run.
        transport: name of the transport.
        wall_s: wall time of the loop, s.
        exchanges: number of exchanges between plant and controller.
        lane: why the exchanges used the fast lane or the bus; empty without processes.
        realtime: real-time profile of the processes; empty without one.
        busy_s: wall time in which each role worked, by its name, s; empty without processes. A
            program of the user's does not report its time.
        waited_s: wall time in which the plant waited for the others or the clock, s.
        repeats: the recording that this run repeats, if any.
        differs: first difference from that recording; empty if the bytes are equal.
        verifies: whether a verification was requested.
        verification: its result; None if no impact ends within the run.
    """

    setup: Setup
    recording: Recording
    assessed: verdicts.RunAssessment
    balance: EnergyBalance
    transport: str
    wall_s: float
    exchanges: int
    lane: str = ""
    realtime: str = ""
    busy_s: Mapping[str, float] = field(default_factory=dict)
    waited_s: float = 0.0
    repeats: Path | None = None
    differs: str | None = None
    verifies: bool = False
    verification: Verification | None = None

    @property
    def expects(self) -> tuple[float | None, float]:
        """The expected error and the requested one, relative."""
        return self.assessed.result.expected_error, self.assessed.requested_accuracy
