"""One self-contained HTML page of a run."""

import base64
import json
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hertzloop.commands.listen import heard_of
from hertzloop.commands.replaying import prepare, scene_of
from hertzloop.loop.compiled import uncontrolled_rows
from hertzloop.results import figures, report, what_ran
from hertzloop.scenes.scene import Scene, SceneError
from recordings.reader import Recording
from recordings.replay.as_rerun import Shown
from recordings.replay.data import Deflection
from recordings.replay.scene3d import with_unit
from studies.report import charts
from studies.report.templates import template

_FRAMES = 240
_LISTED = 12  # contacts
_LEVELS = 127  # of a deflection, each way


@dataclass(frozen=True)
class _Sound:
    label: str
    level: str
    data: str  # base64 of a WAV file


def page_of(recording: Recording) -> str:
    """The page. Raises RecordingError if the recording cannot be read or replayed."""
    scene, shown = scene_of(recording), prepare(recording)
    stable = figures.figures_of(scene, figures.blocks_of(recording))
    compared = shown.told.twin is not None
    columns = [("with control" if compared else "this run", stable)]
    if compared:
        free = scene.without_control()
        columns.append(("without", figures.figures_of(free, uncontrolled_rows(free))))
    compare = compared and not stable["stability"]["unstable"]
    sounds, silent = _sounds(recording, scene)
    return template("page.html.j2").render(
        title=shown.told.heading,
        lines=[line.replace("**", "") for line in shown.told.lines],
        problems=recording.problems,
        unstable=stable["stability"]["unstable"],
        headings=["figure of the first impact", *(name for name, _ in columns),
                  *(["change"] if compare else [])],
        noise=_noise([found for _, found in columns], compare),
        impacts=[_impact(found) for found in stable["impacts"][:_LISTED]],
        more_impacts=max(0, len(stable["impacts"]) - _LISTED),
        around=charts.around_first_contact(shown) if shown.contacts else "",
        whole=charts.whole_run(shown),
        spectra=charts.spectra(shown) if shown.told.spectra else "",
        animation=json.dumps(_animation(shown)),
        sounds=sounds,
        silent=silent,
        scene=recording.scene_toml,
        commands=_commands(recording, scene),
        versions=_versions(recording),
    )  # fmt: skip


def _noise(columns: list[dict[str, Any]], compare: bool) -> list[list[str]]:
    """Rows of figures, none where a run has no impact."""
    if not all(found["noise"] for found in columns):
        return []
    return report.noise_rows([found["noise"][0] for found in columns], compare)


def _impact(found: dict[str, float]) -> list[str]:
    return [
        f"{1e3 * found['start_s']:.4f}", f"{1e6 * found['duration_s']:.2f}",
        f"{found['impact_speed_m_s']:.4f}", f"{found['rebound_speed_m_s']:.4f}",
        f"{found['peak_force_n']:.4g}", f"{1e6 * found['plate_energy_j']:.4g}",
    ]  # fmt: skip


def _animation(shown: Shown) -> dict[str, Any]:
    """Deflections around the first contact in 127 levels each way, and what a canvas needs."""
    plate: Deflection = shown.deflection
    low, high = shown.when.selection_ns
    inside = np.flatnonzero((plate.times_ns >= low) & (plate.times_ns <= high))
    if len(inside) < 2:
        inside = np.arange(len(plate.times_ns))
    inside = inside[np.unique(np.linspace(0, len(inside) - 1, _FRAMES).astype(int))]
    full = shown.drawn.full_colour_m
    levels = np.clip(np.round(np.nan_to_num(plate.w_m[inside]) / full * _LEVELS), -127, 127)
    # Rows of a picture go down, y goes up.
    frames = np.ascontiguousarray(levels.astype(np.int8).transpose(0, 2, 1)[:, ::-1])
    gap_m, force_n = (shown.at_frames[name][inside] for name in ("xi_m", "f_a_n"))
    size = float(plate.x_m[-1]), float(plate.y_m[-1])
    actuator = shown.told.actuator_m
    return {
        "frames": base64.b64encode(frames.tobytes()).decode(),
        "count": len(inside), "nx": len(plate.x_m), "ny": len(plate.y_m),
        "x": (plate.x_m / size[0]).tolist(), "y": (1.0 - plate.y_m[::-1] / size[1]).tolist(),
        "aspect": size[1] / size[0], "size": [f"{1e3 * side:g} mm" for side in size],
        "times": [f"{1e-6 * t:.4f} ms" for t in plate.times_ns[inside].tolist()],
        "touching": (gap_m < 0.0).tolist(),
        "force": [with_unit(float(f), "N") for f in np.nan_to_num(force_n)],
        "contact": [plate.contact_point_m[0] / size[0], 1.0 - plate.contact_point_m[1] / size[1]],
        "actuator": [actuator[0] / size[0], 1.0 - actuator[1] / size[1]] if actuator else None,
        "full": with_unit(full, "m"),
    }  # fmt: skip


def _sounds(recording: Recording, scene: Scene) -> tuple[list[_Sound], str]:
    """Sounds at 1 m, or why there are none."""
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        try:
            heard = heard_of(recording, scene, Path(folder), (0.0, 0.0, 1.0), 1.0, 0.3)
        except SceneError as error:
            return [], str(error)
        return [
            _Sound(
                name.replace("-", " "),
                f"{run['level_db']:.1f} dB sound exposure level",
                base64.b64encode(Path(run["file"]).read_bytes()).decode(),
            )
            for name, run in heard["runs"].items()
        ], ""


def _commands(recording: Recording, scene: Scene) -> list[str]:
    """How to come to the same samples."""
    name, changed = what_ran.closest_shipped(scene)
    if name == scene.name and not changed:
        return [f"hertzloop run {name} --seed {scene.run.seed}"]
    return [
        f"hertzloop run {scene.name}.toml    # the scene below, saved under this name",
        f"hertzloop compare {scene.name}.mcap {recording.path.name}",
    ]


def _versions(recording: Recording) -> list[tuple[str, str]]:
    try:
        found = json.loads(recording.metadata.get("versions", "{}"))
    except json.JSONDecodeError:
        return []
    return [(str(name), str(number)) for name, number in dict(found).items()]
