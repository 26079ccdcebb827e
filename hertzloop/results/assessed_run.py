"""Run and record a scene, then assess the run against the same run without control."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread

from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.processes import fork_server
from hertzloop.processes.record import record
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.impacts import through_first_contact
from hertzloop.results.metrics import free_metrics, no_loop
from hertzloop.results.model import parts_of
from hertzloop.results.recorded import blocks_of
from hertzloop.results.run_report import RunReport
from hertzloop.results.verdict import assess_recording
from hertzloop.results.verification import verify
from hertzloop.scene.controller import check_buildable
from hertzloop.scene.setup import Setup

_BACKGROUND_NICE = 10  # so that the second simulation does not delay the loop


def run_and_assess(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    on_progress: Callable[[int], None] = lambda step: None,
) -> RunReport:
    """Run and record a scene, and assess the run.

    Args:
        setup: The setup of the run.
        recording: The MCAP file to write.
        options: Transport, pace, and what to check afterwards.
        on_progress: Called with the number of finished steps.

    Returns:
        The recorded run with its metrics, compared with the same run without control.

    Raises:
        RecordingError: The recording is incomplete, or another run has replaced it.
        RunFailed: A process failed. The other errors of `record` pass, too.
    """
    with _uncontrolled_in_background(setup, options, on_progress) as follow:
        stats = record(setup, recording, options, follow)
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
        verification = verify(setup, through_first_contact(blocks_of(recorded)))
    if options.repeat:
        differs = first_difference(read(options.repeat), recorded)
    balance = recorded.balance
    assert balance is not None  # a recording without one has a problem
    return RunReport(
        setup=setup,
        recording=recorded,
        assessed=assess_recording(setup, recorded, free_metrics(setup)),
        balance=balance,
        parts=parts_of(setup, balance),
        transport=options.transport.value,
        wall_s=stats["wall_s"],
        exchanges=int(stats["exchanges"]),
        lane=stats["lane"],
        realtime=stats.get("realtime", ""),
        busy_s=stats.get("busy_s", {}),
        waited_s=stats["waited_s"],
        repeats=options.repeat,
        differs=differs,
        verifies=options.verify,
        verification=verification,
    )


@contextmanager
def _uncontrolled_in_background(
    setup: Setup, options: RunOptions, on_progress: Callable[[int], None]
) -> Iterator[Callable[[int], None]]:
    """Simulate the run without control in a thread while the processes start, and again from the
    end of their loop on. `free_metrics` keeps the result. Yields the callback for the progress.

    A paced run, or a loop in this process, has no such thread: a thread that calls Python would
    delay each block of the loop.
    """
    if options.transport is not Transport.ZENOH or options.pace:
        yield on_progress
        return
    check_buildable(setup)
    fork_server.prepare()  # before a thread exists

    def simulate() -> None:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, _BACKGROUND_NICE)  # of this thread only
        with suppress(Exception):  # raised again where the metrics are needed
            free_metrics(setup)

    def follow(step: int) -> None:
        if step < setup.steps:
            no_loop.clear()
        else:
            no_loop.set()
        on_progress(step)

    thread = Thread(target=simulate, daemon=True)
    thread.start()
    try:
        yield follow
    finally:
        no_loop.set()
    thread.join()
