"""What an exported plant's step costs in a C program against the compiled loop, its bytes and size.

The C program calls the plant once a step and keeps all that it sees; the compiled loop has its law
besides. Both in turns, by the processor's time, so that whatever else the machine does hits both
alike.
"""

import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.driven import Driven, build, drive
from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    RoundsOption,
    bars,
    check_json,
    compile_first,
    conclude,
    fail,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    write_records,
    written,
)
from hertzloop.interop.fmu import NoCompiler, write_folder
from hertzloop.interop.image import image
from hertzloop.interop.objects import CompileFault
from hertzloop.loop.simulate import SimulatedRun, simulate
from hertzloop.plant.time_series import F_C
from hertzloop.scene.setup import load


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
            for _ in tracked(cpu, range(rounds)):
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


def same_bytes(loop: SimulatedRun, driven: Driven) -> bool:
    """Whether rows and samples of a run and of the exported plant under its forces are the same."""
    every = -(-len(loop.forces) // len(loop.values))
    seen = driven.values["sample"][:-1:every]
    return seen.tobytes() == loop.values.tobytes() and all(
        values.tobytes() == loop.truth[row].tobytes() for row, values in driven.rows().items()
    )


def _differences(loop: SimulatedRun, driven: Driven) -> tuple[float, float]:
    """Of the contact force, relative: until the first impact is over, and at all."""
    force = loop.truth[F_C]
    apart = np.abs(driven.rows()[F_C] - force) / np.max(np.abs(force))
    touching = np.flatnonzero(force)
    over = touching[np.flatnonzero(np.diff(touching) > 1)[:1]]
    end = int(over[0]) + 1 if over.size else len(force)
    return float(np.max(apart[:end])), float(np.max(apart))


_CPUS = ("host", "x86-64-v3", "x86-64")


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 7,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Measure a step of the exported plant in a C program against the compiled loop.

    Also compares its bytes, and states its size. Needs a C compiler.

    Example: python -m benchmarks.exported --quick
    """
    check_json(json_file)
    with results_in(folder, "exported") as made:
        compile_first()
        try:
            found = measure(_CPUS[:1] if quick else _CPUS, 1 if quick else rounds)
        except NoCompiler as error:
            fail(str(error), 2)
        except CompileFault as error:
            fail(str(error), 1)
        write_records(made / "exported.csv", found)
        sizes = [("compiled loop", found[0].loop_us_a_step)]
        sizes += [(f"C program, {row.cpu}", row.us_a_step) for row in found]
        bars(made / "exported.png", "The plant of aluminium-3mm", "us a step", sizes)
    headings = ("for", "us/step", "of the loop's speed", "same bytes", "first impact",
                "whole run", "code, kB", "arrays, kB")  # fmt: skip
    rows = [
        (row.cpu, f"{row.us_a_step:.2f}", f"{row.share:.2f}", "yes" if row.same else "no",
         f"{row.first:.0e}", f"{row.whole:.0e}", f"{row.code_kb:.0f}", f"{row.arrays_kb:.0f}")
        for row in found
    ]  # fmt: skip
    out.print(number_table("the plant of aluminium-3mm in a C program", headings, rows, text=1))
    out.print("first impact, whole run: largest difference of the contact force, of its largest")
    written(made, "exported.csv", "exported.png")
    first = found[0]
    conclude(
        f"For this processor the exported plant takes {first.us_a_step:.2f} us a step, "
        f"{first.share:.2f} times the speed of the compiled loop, and its bytes are "
        f"{'equal' if first.same else 'not equal'}."
    )
    write_json(json_file, {"exported": [asdict(row) for row in found]})


if __name__ == "__main__":
    start("benchmarks.exported")
