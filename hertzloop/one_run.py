"""One run from start to report: the main job, whatever carries the messages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from hertzloop.analysis.figures import free_figures
from hertzloop.analysis.impacts import through_first_contact
from hertzloop.analysis.recorded import blocks_of
from hertzloop.analysis.trust import verify
from hertzloop.analysis.verdict import judge
from hertzloop.loop.compiled import record_in_process
from hertzloop.processes.launcher import Launcher
from hertzloop.setup import Setup
from hertzloop.views.data import run_as_json, verification_as_json
from recordings.compare import first_difference
from recordings.reader import holds_a_run, read
from recordings.writer import RecordingError


class Transport(StrEnum):
    """Three ways to run the same closed loop."""

    ZENOH = "zenoh"
    INPROCESS = "inprocess"
    COMPILED = "compiled"


@dataclass(frozen=True)
class RunOptions:
    """How to run a scene; but for `pace`, nothing here changes a sample. See the command line."""

    transport: Transport = Transport.ZENOH
    overwrite: bool = False
    horizon: int | None = None
    endpoints: Sequence[str] | None = None
    name: str | None = None
    timeout_s: float = 5.0
    verify: bool = False
    fast_lane: bool = True
    realtime: str = "off"
    pace: float | None = None  # simulated over wall time; None: in lock-step
    repeat: Path | None = None  # a recording whose forces act, late ones as late as there


def _check_parts(setup: Setup) -> None:
    """Build all parts of a scene once. Raises SceneError."""
    setup.start_sensor()
    setup.start_controller()


def record(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    on_progress: Callable[[int], None] = lambda step: None,
) -> dict[str, Any]:
    """Run and record a scene; wall time and exchanges of the loop.

    Raises RunFailed, BusError, StreamFault or RecordingError with one sentence; SceneError for
    parts that cannot be built, before there is a file.
    """
    _check_parts(setup)
    if options.transport is Transport.ZENOH:
        with Launcher(
            setup,
            recording,
            overwrite=options.overwrite,
            horizon=options.horizon,
            endpoints=options.endpoints,
            name=options.name,
            timeout_s=options.timeout_s,
            fast_lane=options.fast_lane,
            realtime=options.realtime,
            pace=options.pace,
            repeat=options.repeat,
        ) as processes:
            return processes.wait(on_progress)
    loop = record_in_process(
        setup,
        recording,
        compiled=options.transport is Transport.COMPILED,
        horizon=options.horizon,
        overwrite=options.overwrite,
        on_progress=on_progress,
    )
    return dict(vars(loop))


def run_scene(
    setup: Setup,
    recording: Path,
    options: RunOptions,
    on_progress: Callable[[int], None] = lambda step: None,
) -> dict[str, Any]:
    """Run and record a scene; the report that `run --json` writes. Raises as `record`."""
    stats = record(setup, recording, options, on_progress)
    recorded = read(recording)
    if recorded.metadata.get("run_id") != stats["run_id"]:
        raise RecordingError(
            f"{recording} holds run {recorded.metadata.get('run_id')}, not {stats['run_id']} that "
            "was started here: another run has replaced it"
        )
    if recorded.problems:
        raise RecordingError(f"{recording}: {recorded.problems[0]}")
    verified = None
    if options.verify:
        rows = through_first_contact(blocks_of(recorded))
        verified = verify(setup, rows)
    report = run_as_json(
        setup,
        recorded,
        judge(setup, recorded, free_figures(setup)),
        transport=options.transport.value,
        wall_s=stats["wall_s"],
        exchanges=int(stats["exchanges"]),
        lane=stats["lane"],
        realtime=stats.get("realtime", ""),
    )
    if options.repeat:
        report["repeats"] = str(options.repeat)
        report["differs"] = first_difference(read(options.repeat), recorded)
    if options.verify:
        report["verification"] = verification_as_json(verified)
    return report


def what_is_kept(recording: Path, since_s: float) -> str:
    """What a person finds of a run that was started at `since_s` (seconds since the epoch) and
    did not end."""
    # Until something comes to replace it, an existing file is kept.
    if holds_a_run(recording) and recording.stat().st_mtime >= since_s:
        return f"what was recorded until now is in {recording}"
    return "nothing was recorded"
