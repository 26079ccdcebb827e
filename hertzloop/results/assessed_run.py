"""Run and record a scene, then assess the run against the same run without control."""

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hertzloop.bus.messages_pb2 import EnergyBalance
from hertzloop.loop.run_options import RunOptions
from hertzloop.processes.launcher import Launcher
from hertzloop.processes.record import Progress, record, told_where, unseen
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.inspection import Assessment, Inspected, inspected
from hertzloop.results.recorded import truth_of
from hertzloop.results.verification import Verification, verify
from hertzloop.scene.setup import Setup


class RecordingRemoved(RecordingError):
    """The recording of a run that has ended is gone."""

    exit_status = 1


@dataclass(frozen=True)
class RunReport:
    """A recorded run with its assessment.

    Attributes:
        setup: the setup of the run.
        options: how it was run.
        inspected: the recording, as read after the run, with its metrics.
        assessment: the metrics of the run, beside those without control.
        balance: energy and momentum balance at the end of the run.
        stats: `wall_s`, wall time of the loop, s; `exchanges` between plant and controller;
            `shared_memory`, why these used shared memory or the bus; `realtime`, the real-time
            profile.
        differs: first difference from the recording that the run repeats; empty if the bytes are
            equal, None without one.
        verification: result of a verification; None if no impact ends within the run.
    """

    setup: Setup
    options: RunOptions
    inspected: Inspected
    assessment: Assessment
    balance: EnergyBalance
    stats: Mapping[str, Any]
    differs: str | None = None
    verification: Verification | None = None

    @property
    def expects(self) -> tuple[float | None, float]:
        """The expected error and the requested one, relative."""
        return self.assessment.result.expected_error, self.setup.run.accuracy


def run_and_assess(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    shown: Callable[[Launcher | None], AbstractContextManager[Progress]] = unseen,
) -> RunReport:
    """Run and record a scene, and assess the run.

    Args:
        setup: The setup of the run.
        recording: The MCAP file to write.
        options: Transport, pace, and what to check afterwards.
        shown: Shows the run while it lasts; see `record`.

    Returns:
        The recorded run with its metrics, compared with the same run without control.

    Raises:
        RecordingError: The recording is incomplete, or another run has replaced it.
        RunFailed: A process failed. The other errors of `record` pass, too.
    """
    with told_where(recording):
        stats = record(setup, recording, options, shown)
    if not recording.exists():
        raise RecordingRemoved(
            f"{recording} was removed or renamed while the run wrote it, so its recording is gone. "
            "Run it again."
        )
    recorded = read(recording)
    if recorded.metadata.get("run_id") != stats["run_id"]:
        raise RecordingError(
            f"{recording} holds run {recorded.metadata.get('run_id')}, not {stats['run_id']} that "
            "was started here: another run has replaced it"
        )
    if recorded.problems:
        raise RecordingError(f"{recording}: {recorded.problems[0]}")
    verification = differs = None
    if options.verify:
        verification = verify(setup, truth_of(recorded))
    if options.repeat:
        differs = first_difference(read(options.repeat), recorded)
    found = inspected(recorded, against_none=True, setup=setup, most_work=math.inf)
    if found.assessment is None:
        raise RecordingError(f"{recording}: {found.problems[-1]}")
    balance = recorded.balance
    assert balance is not None  # a recording without one has a problem
    return RunReport(setup, options, found, found.assessment, balance, stats, differs, verification)
