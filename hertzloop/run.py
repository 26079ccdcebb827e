"""One run from start to report: the main job, whatever carries the messages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from hertzloop import figures
from hertzloop.compiled import simulate
from hertzloop.inprocess import record_in_process
from hertzloop.launcher import Launcher
from hertzloop.scene import Scene
from hertzloop.verify import as_json, verify
from recordings.reader import read
from recordings.writer import RecordingError


class Transport(StrEnum):
    """Three ways to run the same closed loop."""

    ZENOH = "zenoh"
    INPROCESS = "inprocess"
    COMPILED = "compiled"


@dataclass(frozen=True)
class RunOptions:
    """How to run a scene; nothing here changes a sample. See the command line for meanings."""

    transport: Transport = Transport.ZENOH
    overwrite: bool = False
    horizon: int | None = None
    ports: Sequence[int] | None = None
    name: str | None = None
    timeout_s: float = 5.0
    verify: bool = False


def run_scene(
    scene: Scene,
    recording: Path,
    options: RunOptions,
    on_progress: Callable[[int], None] = lambda step: None,
) -> dict[str, Any]:
    """Run and record a scene; the report that `run --json` writes.

    Raises RunFailed, BusError, StreamFault or RecordingError with one sentence.
    """
    if options.transport is Transport.ZENOH:
        with Launcher(
            scene,
            recording,
            overwrite=options.overwrite,
            horizon=options.horizon,
            ports=options.ports,
            name=options.name,
            timeout_s=options.timeout_s,
        ) as processes:
            stats = processes.wait(on_progress)
    else:
        loop = record_in_process(
            scene,
            recording,
            compiled=options.transport is Transport.COMPILED,
            horizon=options.horizon,
            overwrite=options.overwrite,
            on_progress=on_progress,
        )
        stats = vars(loop)
    recorded = read(recording)
    if recorded.problems:
        raise RecordingError(f"{recording}: {recorded.problems[0]}")
    without = scene.without_control()
    verified = None
    if options.verify:
        verified = verify(scene, figures.rows_of(recorded))
    report = figures.run_report(
        scene,
        recorded,
        figures.figures_of(without, simulate(without).rows),
        transport=options.transport.value,
        wall_s=stats["wall_s"],
        exchanges=int(stats["exchanges"]),
    )
    if options.verify:
        report["verification"] = as_json(verified)
    return report
