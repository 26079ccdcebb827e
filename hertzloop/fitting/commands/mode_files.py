"""Write modes as a file and a scene beside it, for the command `scene modes`."""

import shlex
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomli_w

from hertzloop.cli import outputs, prepare
from hertzloop.cli.terminal import fail, out
from hertzloop.common.atomic_files import atomic_write
from hertzloop.plant.structures.mode_file import SUFFIXES, ModeTable, write_modes
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene import model_error
from hertzloop.scene.build import check_modes_reach_impact
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import with_modes_file
from hertzloop.scene.scene import possible_name
from hertzloop.scene.setup import Setup, load

# With these settings any modes can be simulated.
_COMPLETE = ("plate.tail=spring", "plate.residual_flexibility_m_n=0")


@dataclass(frozen=True)
class ModesOutput:
    """Scene and files of the command.

    Args:
        scene: name or file of the scene.
        settings: values of --set.
        out_file: file of modes to write; None for a name of the command.
        json_file: file of --json.
        overwrite: whether existing files may be replaced.
    """

    scene: str
    settings: list[str]
    out_file: Path | None
    json_file: Path | None
    overwrite: bool

    @property
    def base(self) -> str:
        """The scene and its settings, on one line."""
        changed = ", ".join(" ".join(one.split()) for one in self.settings)
        return f"{self.scene} with {changed}" if changed else self.scene

    def target(self, stem: str) -> Path:
        """Return the file of modes to write; end the command if its format is unknown."""
        path = self.out_file or Path(f"{stem}-modes.csv")
        if path.suffix not in SUFFIXES:
            fail(f"--out = {path}: unknown format. Use a name that ends in {', '.join(SUFFIXES)}.")
        return path


def write_plate_modes(output: ModesOutput, grid: bool) -> None:
    """Write the modes of a scene's plate, with shapes on a grid if asked for."""
    resolved = prepare.scene_from(output.scene, output.settings, None)
    target = output.target(resolved.name)
    if grid and target.suffix != ".npz":
        fail(f"--out = {target}: cannot hold shapes on a grid. Use an .npz file with --grid.")
    read = outputs.files_of(resolved, output.scene, *output.settings)
    outputs.check_output(target, output.overwrite, read=read)
    outputs.check_json(output.json_file, target)

    table = modes_of_scene(resolved, grid)
    atomic_write(target, write_modes(target.suffix, table))
    out.say(
        f"{len(table.omega_rad_s)} modes up to {mode_hz(table, -1):.4g} Hz (modes "
        "of equal frequency merged, modes without participation dropped), and a residual "
        f"flexibility of {table.residual_flexibility_m_n:.4g} m/N; written: {target}"
    )
    if resolved.scene.actuator.mass_kg or resolved.scene.sensors.mass_kg:
        out.say("The mass of actuator and sensor is not part of them. A scene adds it to a file.")
    outputs.write_json(
        output.json_file,
        {
            "modes": len(table.omega_rad_s),
            "highest_hz": mode_hz(table, -1),
            "residual_flexibility_m_n": table.residual_flexibility_m_n,
            "files": [str(target)],
        },
    )


@dataclass(frozen=True)
class WrittenModes:
    """Files of measured modes that were written.

    Args:
        expected_error: of the first impact in the scene; None if the scene cannot be run yet.
        warning: why the scene cannot be run yet, "" if it can.
        files: the file of modes and the scene.
    """

    expected_error: float | None
    warning: str
    files: tuple[Path, Path]


def write_measured_modes(table: ModeTable, target: Path, output: ModesOutput) -> WrittenModes:
    """Write modes to a file and a scene with them beside it, and print what was written.

    A scene whose modes end too low for its striker, or have no residual flexibility, is written
    with a warning.
    """
    beside = target.with_suffix(".toml")
    setup, warning = _write(table, target, output)
    low, high = mode_hz(table, 0), mode_hz(table, -1)
    found = f"{len(table.omega_rad_s)} modes from {low:.5g} to {high:.5g} Hz."
    expected = None
    if warning:
        out.say(f"{found} The scene cannot be run yet: {warning}.")
    else:
        expected = model_error.expected_error(setup)
        out.say(
            f"{found} Expected error of the first impact in this scene: {100 * expected:.2g} %."
        )
    then = shlex.join(["hertzloop", "run", str(beside)])
    out.say(
        f"written: {target} and {beside}, which has striker, material of the plate "
        f"({setup.plate_material or 'own numbers'}) and law of {output.base}."
        + ("" if warning else f" Next: {then}")
    )
    return WrittenModes(expected, warning, (target, beside))


def _write(table: ModeTable, target: Path, output: ModesOutput) -> tuple[Setup, str]:
    """Write a file of modes, and a scene with them beside it.

    Returns:
        The setup of the scene, and why it cannot be run yet, "" if it can.
    """
    content = write_modes(target.suffix, table)
    data = with_modes_file(output.scene, output.settings, target.name, possible_name(target.stem))
    data["shows"] = f"Modes measured, in {target.name}; striker and law of {output.base}"
    text = f"# Modes by hertzloop scene modes; all else from {output.base}.\n{tomli_w.dumps(data)}"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / target.name).write_bytes(content)
        trial = Path(folder) / target.with_suffix(".toml").name
        trial.write_text(text, encoding="utf-8")
        warning = ""
        try:
            setup = load(str(trial))
            check_modes_reach_impact(setup.plant)
        except SceneError as error:
            warning = str(error).rstrip(".")
            setup = load(str(trial), _COMPLETE)  # Other errors of the scene end the command.
    atomic_write(target, content)
    atomic_write(target.with_suffix(".toml"), text)
    return setup, warning


def mode_hz(table: ModeTable, mode: int) -> float:
    """Return the frequency of a mode, Hz."""
    return float(table.omega_rad_s[mode] / (2 * np.pi))
