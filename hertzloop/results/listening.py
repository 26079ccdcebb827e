"""What a run sounds like on the axis of its plate, as WAV files."""

import math
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.protocols import Structure
from hertzloop.plant.metrics.noise import RADIATED_UP_TO_HZ
from hertzloop.plant.metrics.sound import FADE_FROM, Excitation, Grid, Radiator, pressure_pa
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.deflection import forces_on_plate
from hertzloop.results.recorded import missing_from, truth_of
from hertzloop.scene.build import free_series
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

RATE_HZ = 48_000
_NODES_A_WAVE = 6.0
_NODES = (8, 200)  # least and most along a side
_MOST_MODES = 20_000
_SILENT = 1e-9  # of the largest volume: of modes whose halves cancel
_PEAK = 0.9  # of full scale, for the loudest sample of all that are compared
_FULL_SCALE = 32767
_WHOLE = 480  # samples: a whole number of steps


def radiator_of(setup: Setup) -> Radiator:
    """Return the modes of a scene's plate up to 20 kHz, with the volume that each moves.

    Raises:
        SceneError: The structure has no shapes on a grid, or too many modes.
    """
    spec, structure = setup.plant, setup.plant.plate
    limit_hz = _limit_hz(setup)
    if structure.modes_below(limit_hz) > _MOST_MODES:
        raise SceneError(
            f"about {structure.modes_below(limit_hz):.4g} modes below {limit_hz:.3g} Hz radiate; "
            f"the limit is {_MOST_MODES}. Use a smaller or stiffer plate"
        )
    omega_max = 2.0 * math.pi * limit_hz
    modes = structure.modes(omega_max, spec.contact_point_m, spec.actuator_point_m)
    x, y, shapes = _shapes_of(setup, omega_max)
    cells = np.outer(np.gradient(x), np.gradient(y)).ravel()  # area of each place
    volume_m2 = shapes.reshape(len(modes.omega), -1) @ cells
    heard = abs(volume_m2) > _SILENT * np.max(abs(volume_m2), initial=0.0)
    return Radiator(
        omega=modes.omega[heard],
        eta=np.broadcast_to(modes.eta, modes.omega.shape)[heard],
        scale_per_kg=modes.scale_per_kg,
        at_contact=modes.at_contact[heard],
        at_actuator=modes.at_actuator[heard],
        volume_m2=volume_m2[heard],
    )


def _shapes_of(setup: Setup, omega_max: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the places of a grid along both sides, m, and the shapes of the modes on it."""
    structure = setup.plant.plate
    if not structure.has_shapes:
        raise SceneError(
            f"nothing can be heard of {structure}, which has no shapes on a grid; a file of "
            "plate.modes may have them as the arrays x_m, y_m and shape_grid of an .npz file"
        )
    if structure.grid_m is not None:
        x, y = structure.grid_m
    else:
        spacing_m = _half_wave_m(structure, omega_max) * 2.0 / _NODES_A_WAVE
        x, y = (_midpoints(length, spacing_m) for length in setup.scene.plate.size_m or (1.0, 1.0))
    return x, y, structure.on_grid(omega_max, x, y)


def _half_wave_m(structure: Structure, omega_max: float) -> float:
    """Return half of the shortest bending wave, m; a thousandth of a metre where it is unknown."""
    plate = structure.local_plate
    if plate is None:
        return 1e-3
    speed = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2)
    return math.pi * math.sqrt(speed / omega_max)


def _midpoints(length: float, spacing: float) -> np.ndarray:
    count = min(max(_NODES[0], math.ceil(length / spacing)), _NODES[1])
    return (np.arange(count) + 0.5) * (length / count)


def drive_of(setup: Setup, truth: np.ndarray) -> Excitation:
    """Return the forces on the plate from a time series, shape (10, steps). Raises SceneError for a
    run that explodes."""
    contact, _, actuator, _ = forces_on_plate(setup.plant, truth)
    if not (np.isfinite(contact).all() and np.isfinite(actuator).all()):
        raise SceneError("the run has numbers that are not finite; there is nothing to hear")
    return Excitation(contact, actuator, setup.run.step_s)


def grid_of(setup: Setup, tail_s: float, slow: float = 1.0) -> Grid:
    """Return samples from the start of a run to `tail_s` after its end: so many that they sound at
    RATE_HZ when played `slow` times slower."""
    step_s = 1.0 / (RATE_HZ * slow)
    steps = math.ceil((setup.run.duration_s + tail_s) / step_s / _WHOLE) * _WHOLE
    # The band fades out above all modes that sound: else it would take from their energy.
    up_to = min(_limit_hz(setup) / FADE_FROM, 0.45 / step_s)
    return Grid(steps, step_s, up_to)


def _limit_hz(setup: Setup) -> float:
    """Return the frequency up to which modes sound."""
    return min(RADIATED_UP_TO_HZ, setup.plant.frequency_limit_hz)


def write_sounds(
    recording: Recording, setup: Setup, folder: Path, distance_m: float, slow: float, tail_s: float
) -> dict[str, Any]:
    """Write the sound of a recording as WAV files, with and without control, on one scale.

    Args:
        recording: The recording.
        setup: The setup of the run.
        folder: The folder for the files.
        distance_m: Distance of the listener from the plate, on its axis, m.
        slow: Factor by which the sound is slowed down.
        tail_s: Time after the run, s.

    Returns:
        Files and levels by run, as `listen --json` writes them.

    Raises:
        RecordingError: The recording cannot be used.
        SceneError: The structure has no shapes on a grid, or the run is not finite.
        OSError: A file cannot be written.
    """
    if (step := missing_from(recording, setup)) is not None:
        raise RecordingError(
            f"{recording.path}: step {step} is missing. The sound follows from all steps of a run."
        )
    grid, radiator = grid_of(setup, tail_s, slow), radiator_of(setup)
    recorded = truth_of(recording)
    runs = {"without-control": recorded}
    if setup.scene.controller.has_law:
        runs = {"with-control": recorded, "without-control": free_series(setup.without_control())}
    sounds = {
        name: pressure_pa(radiator, drive_of(setup, truth), distance_m, grid)
        for name, truth in runs.items()
    }
    full_pa = max(float(np.abs(one).max()) for one in sounds.values()) / _PEAK
    data: dict[str, Any] = {
        "distance_m": distance_m,
        "slow": slow,
        "tail_s": tail_s,
        "full_scale_pa": full_pa,
        "runs": {},
    }
    for name, pressure in sounds.items():
        path = folder / f"{recording.path.stem}-{name}.wav"
        _write_wav(path, pressure / full_pa if full_pa > 0.0 else pressure)
        exposure = float(np.sum(pressure**2)) * grid.step_s
        data["runs"][name] = {
            "file": str(path),
            "peak_pa": float(np.abs(pressure).max()),
            "exposure_pa2_s": exposure,
            # Sound exposure level, dB re (20 uPa)^2 1 s.
            "level_db": 10.0 * math.log10(exposure / 4e-10) if exposure > 0.0 else -math.inf,
        }
    return data


def _write_wav(path: Path, share: np.ndarray) -> None:
    """Write samples, as shares of full scale, in 16 bits. Raises NotWritten."""
    codes = np.round(np.clip(share, -1.0, 1.0) * _FULL_SCALE).astype("<i2")
    scipy.io.wavfile.write(sound := BytesIO(), RATE_HZ, codes)
    atomic_write(path, sound.getvalue())
