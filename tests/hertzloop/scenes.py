"""The scene of most tests, with settings, and what recording a scene gives."""

import json
from pathlib import Path
from typing import Any

from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.run_options import RunOptions
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import Setup, load


def aluminium_3mm(*settings: str) -> Setup:
    """The scene `aluminium-3mm` with settings, each as `KEY=VALUE`."""
    return load("aluminium-3mm", settings)


def recorded(scene: Setup, file: Path, compiled: bool = True) -> Recording:
    """The whole recording of a run of a scene in this process."""
    record_in_process(scene, file, compiled=compiled)
    found = read(file)
    assert not found.problems
    return found


def run_recorded(scene: Setup, file: Path, transport: str = "compiled") -> Recording:
    """The whole recording of a run over a transport, as `hertzloop run` makes it."""
    run_and_assess(scene, file, RunOptions(transport=transport, overwrite=True))
    found = read(file)
    assert not found.problems
    return found


def json_in(file: Path | str) -> Any:
    """What a file holds as JSON."""
    return json.loads(Path(file).read_text())
