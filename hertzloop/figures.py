"""Figures of a run, from its recording or from memory: what `run` and `inspect` report."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from hertzloop.impact_rows import impacts_of_rows
from hertzloop.model_cost import chosen_model
from hertzloop.plant_node import TRUTH_FIELDS
from hertzloop.scene import Scene
from recordings.reader import Recording


def rows_of(recording: Recording) -> np.ndarray:
    """Rows of truth of a recording, shape (8, steps); the actuator's place is the struck point
    and the contact force constant over a step where the recording does not say otherwise."""
    arrays = recording.truth.arrays
    if not recording.truth.samples:
        return np.zeros((len(TRUTH_FIELDS), 0))
    missing = {"xi_a_m": arrays["xi_p_m"], "f_c1_n": np.zeros(recording.truth.samples)}
    return np.stack([arrays[name] if name in arrays else missing[name] for name in TRUTH_FIELDS])


def figures_of(scene: Scene, rows: np.ndarray) -> dict[str, list[dict[str, float]]]:
    """Impacts and their noise figures for --json from rows of truth.

    Two lists of the same length: `impacts` with keys as in `Impact`, `noise` as in
    `ImpactNoise`.
    """
    found = impacts_of_rows(scene, rows)
    return {
        "impacts": [asdict(rows_of_impact.impact) for rows_of_impact in found],
        "noise": [asdict(rows_of_impact.noise) for rows_of_impact in found],
    }


def run_report(
    scene: Scene,
    recording: Recording,
    uncontrolled: dict[str, list[dict[str, float]]],
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
        "scheme": scene.run.scheme,
        "steps": scene.steps,
        "wall_s": wall_s,
        "real_time_factor": scene.run.duration_s / wall_s if wall_s else math.inf,
        "exchanges": exchanges,
        "residuals": {"momentum": books.momentum_residual, "energy": books.energy_residual},
        "frequencies": books.frequencies,
        "frequency_limit_hz": books.frequency_limit_hz,
        "expected_error": books.expected_error,
        "requested_accuracy": scene.run.accuracy,
        "model": chosen_model(scene),
        "newton_iterations_max": books.newton_iterations_max,
        **figures_of(scene, rows_of(recording)),
        "uncontrolled": uncontrolled,
        "recording": str(recording.path),
    }
