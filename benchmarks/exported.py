"""What an exported plant's step costs in a C program against the compiled loop, and its bytes.

The C program calls the plant once a step and keeps all that it sees; the compiled loop has its law
besides. Both in turns, by the processor's time, so that whatever else the machine does hits both
alike.
"""

import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, RoundsOption, start
from benchmarks.results import results_in
from benchmarks.scenes import load
from benchmarks.timing import in_turn
from hertzloop.cli.terminal import fail
from hertzloop.interop import fmu
from hertzloop.interop.fmu import NoCompiler, write_folder
from hertzloop.interop.image import image
from hertzloop.interop.objects import CompileFault
from hertzloop.loop.simulate import SimulatedRun, simulate
from hertzloop.plant.time_series import F_A, F_C, V_P, XI, XI_P, XI_S


@dataclass(frozen=True)
class Driven:
    """What a plant showed: `values` at the start and after every step, energies at the end by
    name, and the processor's time of the steps."""

    values: np.ndarray
    energies: dict[str, float]
    cpu_s: float

    def rows(self) -> dict[int, np.ndarray]:
        """Rows of truth by their index, without the state after the last step."""
        states = {
            XI: "gap_m",
            XI_S: "sphere_height_m",
            XI_P: "plate_deflection_m",
            V_P: "plate_velocity_m_s",
        }
        means = {F_C: "contact_force_n", F_A: "actuator_force_n"}
        rows = {row: self.values[name][:-1] for row, name in states.items()}
        return rows | {row: self.values[name][1:] for row, name in means.items()}


def build(folder: Path, source: Path = fmu.C / "drive.c") -> Path:
    """A program in C beside the library of an exported folder that it uses."""
    program = folder / source.stem
    compiler = ["cc", "-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror"]
    libraries = ["-L", str(folder), "-lhertzloop_plant", "-Wl,-rpath,$ORIGIN"]
    subprocess.run([*compiler, "-I", folder, "-o", program, source, *libraries], check=True)
    return program


def drive(program: Path, forces: np.ndarray) -> Driven:
    """Run the plant of a program `drive` under forces (N), one a step."""
    given, seen = program.with_name("forces.bin"), program.with_name("values.bin")
    forces.tofile(given)
    said = subprocess.run([program, given, seen], check=True, capture_output=True, text=True)
    data = seen.read_bytes()
    values = np.frombuffer(data, fmu.VALUES, len(forces) + 1)
    balance = np.frombuffer(data, np.float64, offset=values.nbytes)
    energies = dict(zip(fmu.ENERGIES, map(float, balance), strict=True))
    return Driven(values, energies, float(said.stdout))


@dataclass(frozen=True)
class Exported:
    """An exported plant for a processor. `share`: of the compiled loop's speed; `same`: all bytes
    of rows and samples."""

    cpu: str
    us_a_step: float
    loop_us_a_step: float
    share: float
    same: bool


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

            def of_loop() -> float:
                started = time.thread_time()
                simulate(setup)
                return 1e6 * (time.thread_time() - started) / setup.run.steps

            def of_program(program: Path = program) -> float:
                return 1e6 * drive(program, loop.forces).cpu_s / setup.run.steps

            costs = in_turn({"compiled loop": of_loop, "C program": of_program}, rounds)
            driven = drive(program, loop.forces)
        loop_us, us = (cost.least_us for cost in costs)
        found.append(Exported(cpu, us, loop_us, loop_us / us, same_bytes(loop, driven)))
    return found


def same_bytes(loop: SimulatedRun, driven: Driven) -> bool:
    """Whether rows and samples of a run and of the exported plant under its forces are the same."""
    every = -(-len(loop.forces) // len(loop.values))
    seen = driven.values["sample"][:-1:every]
    return seen.tobytes() == loop.values.tobytes() and all(
        values.tobytes() == loop.truth[row].tobytes() for row, values in driven.rows().items()
    )


_CPUS = ("host", "x86-64-v3", "x86-64")


def main(folder: OutDirOption = None, rounds: RoundsOption = 7, quick: QuickOption = False) -> None:
    """Measure a step of the exported plant in a C program against the compiled loop.

    Also compares its bytes. Needs a C compiler.

    Example: python -m benchmarks.exported --quick
    """
    with results_in(folder, "exported", "modal") as results:
        try:
            found = measure(_CPUS[:1] if quick else _CPUS, 1 if quick else rounds)
        except NoCompiler as error:
            fail(str(error), 2)
        except CompileFault as error:
            fail(str(error), 1)
        results.write("exported", found)
        results.table(
            "the plant of aluminium-3mm in a C program",
            {
                "for": "{.cpu}",
                "us/step": "{.us_a_step:.2f}",
                "of the loop's speed": "{.share:.2f}",
                "same bytes": lambda row: "yes" if row.same else "no",
            },
            found,
        )
        first = found[0]
        results.conclude(
            f"For this processor the exported plant takes {first.us_a_step:.2f} us a step, "
            f"{first.share:.2f} times the speed of the compiled loop, and its bytes are "
            f"{'equal' if first.same else 'not equal'}."
        )


if __name__ == "__main__":
    start("benchmarks.exported")
