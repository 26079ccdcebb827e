"""Run and record a scene, in whichever transport."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from hertzloop.bus.port import BusError
from hertzloop.bus.streams import StreamFault
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.processes.launcher import Launcher, RunFailed
from hertzloop.recordings.reader import holds_a_run
from hertzloop.recordings.writer import RecordingError
from hertzloop.scene.controller import check_buildable
from hertzloop.scene.setup import Setup

Progress = Callable[[int], None]


def unseen(_: Launcher | None) -> AbstractContextManager[Progress]:
    """Show nothing of a run."""
    return nullcontext(lambda step: None)


def record(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    shown: Callable[[Launcher | None], AbstractContextManager[Progress]] = unseen,
) -> dict[str, Any]:
    """Run and record a scene, in the transport of the options.

    Args:
        setup: The setup of the run.
        recording: The MCAP file to write.
        options: Transport and more.
        shown: Shows the run while it lasts. It is called with the launcher, if there is one, once
            the processes are started, and yields a function of the number of finished steps.

    Returns:
        Wall time and exchanges of the loop.

    Raises:
        SceneError: A part of the scene cannot be built; no file was written.
        RunFailed, BusError, StreamFault, RecordingError: The run has failed.
    """
    check_buildable(setup)
    if options.transport is Transport.ZENOH:
        with Launcher(setup, recording, options) as launcher, shown(launcher) as on_progress:
            return launcher.wait(on_progress)
    compiled = options.transport is Transport.COMPILED
    with shown(None) as on_progress:
        loop = record_in_process(setup, recording, options, on_progress, compiled=compiled)
    return dict(vars(loop))


@contextmanager
def told_where(recording: Path) -> Iterator[None]:
    """Add to the sentence of a run that fails where its readable recording is."""
    since_s = time.time()
    try:
        yield
    except (RunFailed, BusError, StreamFault, RecordingError) as error:
        if _was_recorded(recording, since_s):
            kept = f"The recording up to then is in {recording}: run 'hertzloop inspect' on it."
            error.args = (f"{str(error).removesuffix('.')}. {kept}",)
        raise


def what_is_kept(recording: Path, since_s: float) -> str:
    """Return what is left of a run that did not end, in a clause.

    Args:
        recording: The file that it wrote.
        since_s: When the run was started, in seconds since the epoch.
    """
    # Until something comes to replace it, an existing file is kept.
    if _was_recorded(recording, since_s):
        return f"the recording up to now is in {recording}"
    return "no recording was written"


def _was_recorded(recording: Path, since_s: float) -> bool:
    return holds_a_run(recording) and recording.stat().st_mtime >= since_s
