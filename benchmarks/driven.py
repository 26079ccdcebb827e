"""An exported plant in a program in C, under forces given step by step."""

import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hertzloop.interop import fmu
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
        states = {XI: "gap_m", XI_S: "sphere_height_m", XI_P: "plate_deflection_m",
                  V_P: "plate_velocity_m_s"}  # fmt: skip
        means = {F_C: "contact_force_n", F_A: "actuator_force_n"}
        rows = {row: self.values[name][:-1] for row, name in states.items()}
        return rows | {row: self.values[name][1:] for row, name in means.items()}


def build(folder: Path, source: Path = fmu.C / "drive.c") -> Path:
    """A program in C beside the library of an exported folder that it uses."""
    program = folder / source.stem
    subprocess.run(
        ["cc", "-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror", "-I", folder, "-o", program,
         source, "-L", folder, "-lhertzloop_plant", "-Wl,-rpath,$ORIGIN"],
        check=True,
    )  # fmt: skip
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
