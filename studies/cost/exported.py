"""What an exported plant's step costs in a C program against the compiled loop, its bytes and size.

The C program calls the plant once a step and keeps all that it sees; the compiled loop has its law
besides. Both in turns, by the processor's time, so that whatever else the machine does hits both
alike.
"""

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hertzloop.analysis.impacts import F_C
from hertzloop.interop.environment import Driven, build, drive
from hertzloop.interop.fmu import write_folder
from hertzloop.interop.image import image
from hertzloop.loop.compiled import Simulated, simulate
from hertzloop.setup import load


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
