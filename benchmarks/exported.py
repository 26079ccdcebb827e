"""What an exported plant's step costs in a C program against the compiled loop, its bytes and size.

The C program calls the plant once a step and keeps all that it sees; the compiled loop has its law
besides. Both in turns, by the processor's time, so that whatever else the machine does hits both
alike.
"""

import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from hertzloop.analysis.impacts import F_C
from hertzloop.interop.fmu import Driven, build, drive, write_folder
from hertzloop.interop.image import image
from hertzloop.loop.compiled import Simulated, record_in_process, simulate
from hertzloop.recordings.reader import read
from hertzloop.recordings.replay import as_rerun
from hertzloop.recordings.replay.viewer import ViewerError, frame_times_ms
from hertzloop.setup import load
from hertzloop.views import replaying


@dataclass(frozen=True)
class Exported:
    """An exported plant for a processor. `share`: of the compiled loop's speed; `same`: all bytes
    of rows and samples; `first`, `whole`: largest difference of the contact force to the end of
    the first impact, and of the run, over its largest value; `code_kb`: without its arrays."""

    cpu: str
    us_a_step: float
    loop_us_a_step: float
    share: float
    same: bool
    first: float
    whole: float
    code_kb: float
    arrays_kb: float


def measure(cpus: tuple[str, ...], rounds: int) -> list[Exported]:
    """Of the scene `aluminium-3mm`. Raises NoCompiler and CompileFault as `write_folder`."""
    setup = load("aluminium-3mm")
    made, found = image(setup), []
    loop = simulate(setup)
    for cpu in cpus:
        with tempfile.TemporaryDirectory(prefix="hertzloop-") as name:
            folder = Path(name)
            write_folder(made, cpu, folder)
            program = build(folder)
            there_s, here_s = [], []
            for _ in range(rounds):
                started = time.thread_time()
                simulate(setup)
                here_s.append(time.thread_time() - started)
                driven = drive(program, loop.forces)
                there_s.append(driven.cpu_s)
            size = (folder / "libhertzloop_plant.so").stat().st_size
        us, loop_us = (1e6 * min(times) / setup.steps for times in (there_s, here_s))
        first, whole = _differences(loop, driven)
        arrays = len(made.data)
        found.append(
            Exported(cpu, us, loop_us, loop_us / us, same_bytes(loop, driven), first, whole,
                     (size - arrays) / 1000, arrays / 1000)
        )  # fmt: skip
    return found


def same_bytes(loop: Simulated, driven: Driven) -> bool:
    """Whether rows and samples of a run and of the exported plant under its forces are the same."""
    every = -(-len(loop.forces) // len(loop.values))
    seen = driven.values["sample"][:-1:every]
    return seen.tobytes() == loop.values.tobytes() and all(
        values.tobytes() == loop.rows[row].tobytes() for row, values in driven.rows().items()
    )


def _differences(loop: Simulated, driven: Driven) -> tuple[float, float]:
    """Of the contact force, relative: until the first impact is over, and at all."""
    force = loop.rows[F_C]
    apart = np.abs(driven.rows()[F_C] - force) / np.max(np.abs(force))
    touching = np.flatnonzero(force)
    over = touching[np.flatnonzero(np.diff(touching) > 1)[:1]]
    end = int(over[0]) + 1 if over.size else len(force)
    return float(np.max(apart[:end])), float(np.max(apart))


_FRAMES = 40
_STATES: tuple[Literal["paused", "playing"], ...] = ("paused", "playing")


@dataclass(frozen=True)
class Measured:
    """Median and least of what was measured several times."""

    case: str
    median: float
    least: float


@dataclass(frozen=True)
class ReplayCost:
    """`cases`: from a recording of so many steps, the run without control simulated beside it, to
    an .rrd file of so many MB, without the start of Python; a frame of the whole dashboard. Why
    frames are not known, if they are not."""

    steps: int
    cases: list[Measured]
    megabytes: float
    no_frames: str = ""


def measure_replay(rounds: int, duration_s: float = 0.6) -> ReplayCost:
    """Costs of the scene `aluminium-3mm` of this length."""
    setup = load("aluminium-3mm", [f"run.duration_s={duration_s}"])
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        file, rrd = Path(folder) / "run.mcap", Path(folder) / "run.rrd"
        record_in_process(setup, file, compiled=True)
        found: dict[str, list[float]] = {"to an .rrd file, s": [], "... of processor time, s": []}
        cursor_ns = _convert(file, rrd, ([], []))  # loads what is compiled
        for _ in range(rounds):
            _convert(file, rrd, tuple(found.values()))
        why = ""
        try:
            for state in _STATES:
                case = f"a frame of the viewer, {state}, ms"
                found[case] = frame_times_ms(rrd, cursor_ns, _FRAMES, state)
        except ViewerError as error:
            why = str(error)
        megabytes = 1e-6 * rrd.stat().st_size
    cases = [Measured(c, statistics.median(times), min(times)) for c, times in found.items()]
    return ReplayCost(setup.steps, cases, megabytes, why)


def _convert(file: Path, rrd: Path, times: tuple[list[float], ...]) -> int:
    """Appends seconds on the wall and of processor time; the time of a still picture, ns."""
    wall, spent = time.perf_counter(), time.process_time()
    shown = replaying.prepare(read(file, keep=True))
    as_rerun.save(shown, rrd)
    times[0].append(time.perf_counter() - wall)
    times[1].append(time.process_time() - spent)
    return shown.when.still_ns
