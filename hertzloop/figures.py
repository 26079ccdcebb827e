"""Figures of a run, from its recording or from memory: what `run` and `inspect` report."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from hertzloop import parts
from hertzloop.compiled import Truth
from hertzloop.scene import Scene
from plant.impacts import Impact, impacts
from recordings.reader import Recording


def impacts_in_recording(scene: Scene, recording: Recording) -> list[Impact]:
    """Impacts of a recorded run."""
    a = recording.truth.arrays
    if not recording.truth.samples:
        return []
    return _impacts(
        scene, [a[n] for n in ("xi_m", "xi_s_m", "xi_p_m", "f_c_n", "f_a_n")], a.get("xi_a_m")
    )


def impacts_in_memory(scene: Scene, truth: Truth) -> list[Impact]:
    """Impacts of a run that was only simulated."""
    xi, xi_s, xi_p, _, f_c, f_a, xi_a = truth.rows
    apart = parts.plant_spec(scene)
    same = apart.contact_point_m == apart.actuator_point_m
    return _impacts(scene, [xi, xi_s, xi_p, f_c, f_a], None if same else xi_a)


def _impacts(scene: Scene, rows: list[np.ndarray], xi_a: np.ndarray | None) -> list[Impact]:
    xi, xi_s, xi_p, f_c, f_a = rows
    mass = parts.plant_spec(scene).sphere.mass_kg
    return impacts(xi, xi_s, xi_p, f_c, f_a, xi_a, mass, scene.step_s)


def as_json(found: list[Impact]) -> list[dict[str, float]]:
    """Impacts for --json; keys are the attribute names."""
    return [asdict(impact) for impact in found]


def run_report(
    scene: Scene,
    recording: Recording,
    uncontrolled: list[Impact],
    *,
    transport: str,
    wall_s: float,
    exchanges: int,
) -> dict[str, Any]:
    """Everything that `run --json` writes."""
    books = recording.books
    if books is None:
        raise ValueError("the recording has no books: the run did not end")
    return {
        "scene": scene.name,
        "seed": scene.run.seed,
        "transport": transport,
        "steps": scene.steps,
        "wall_s": wall_s,
        "real_time_factor": scene.run.duration_s / wall_s if wall_s else math.inf,
        "exchanges": exchanges,
        "residuals": {"momentum": books.momentum_residual, "energy": books.energy_residual},
        "frequencies": books.frequencies,
        "frequency_limit_hz": books.frequency_limit_hz,
        "expected_error": books.expected_error,
        "requested_accuracy": scene.run.accuracy,
        "newton_iterations_max": books.newton_iterations_max,
        "impacts": as_json(impacts_in_recording(scene, recording)),
        "uncontrolled": {"impacts": as_json(uncontrolled)},
        "recording": str(recording.path),
    }
