"""Run and record a scene, in whichever transport."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.processes.launcher import Launcher, RunFailed
from hertzloop.recordings.reader import holds_a_run
from hertzloop.scene.controller import check_buildable
from hertzloop.scene.setup import Setup


def record(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    on_progress: Callable[[int], None] = lambda step: None,
) -> dict[str, Any]:
    """Run and record a scene, in the transport of the options.

    Returns:
        Wall time and exchanges of the loop.

    Raises:
        SceneError: A part of the scene cannot be built; no file was written.
        RunFailed, BusError, StreamFault, RecordingError: The run has failed.
    """
    check_buildable(setup)
    if options.transport is Transport.ZENOH:
        started_s = time.time()
        try:
            with Launcher(setup, recording, options) as processes:
                return processes.wait(on_progress)
        except RunFailed as error:
            if not _was_recorded(recording, started_s):
                raise
            kept = f"The recording up to then is in {recording}: run 'hertzloop inspect' on it."
            raise RunFailed(f"{str(error).removesuffix('.')}. {kept}") from error
    compiled = options.transport is Transport.COMPILED
    loop = record_in_process(setup, recording, options, on_progress, compiled=compiled)
    return dict(vars(loop))


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
