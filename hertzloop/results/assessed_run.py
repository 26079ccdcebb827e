"""Run and record a scene, then assess the run against the same run without control."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from hertzloop.loop.run_options import RunOptions
from hertzloop.processes.launcher import Launcher
from hertzloop.processes.record import Progress, record, unseen
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.metrics import free_metrics
from hertzloop.results.recorded import truth_of
from hertzloop.results.run_report import RunReport
from hertzloop.results.verdict import assess_recording
from hertzloop.results.verification import verify
from hertzloop.scene.setup import Setup


class RecordingRemoved(RecordingError):
    """The recording of a run that has ended is gone."""

    exit_status = 1


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
    balance = recorded.balance
    assert balance is not None  # a recording without one has a problem
    return RunReport(
        setup=setup,
        recording=recorded,
        assessed=assess_recording(setup, recorded, free_metrics(setup)),
        balance=balance,
        transport=options.transport.value,
        wall_s=stats["wall_s"],
        exchanges=int(stats["exchanges"]),
        lane=stats["shared_memory"],
        realtime=stats.get("realtime", ""),
        busy_s=stats.get("busy_s", {}),
        waited_s=stats["waited_s"],
        repeats=options.repeat,
        differs=differs,
        verifies=options.verify,
        verification=verification,
    )
