"""What a run sounds like at a point: the modes of its plate, heard through Rayleigh's integral."""

import math
import wave
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.common.atomic_files import atomic_write
from hertzloop.plant.metrics.noise import RADIATED_UP_TO_HZ, SOUND_SPEED_M_S
from hertzloop.plant.metrics.sound import (
    FADE_FROM,
    Excitation,
    Grid,
    Products,
    Radiator,
    pressure_pa,
    radiated_j,
    rung_j,
)
from hertzloop.plant.plant import MOST_MODES
from hertzloop.plant.structures.mode_file import ModeTable
from hertzloop.plant.structures.modes import NO_PARTICIPATION
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.radiation import air_loss_factor, efficiency_wallace
from hertzloop.plant.structures.structure import Structure
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.deflection import force_blocks
from hertzloop.results.impacts import Block
from hertzloop.results.recorded import missing_from, pieces_of
from hertzloop.scene.build import free_series
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

RATE_HZ = 48_000
_NODES_A_WAVE = 6.0  # at the highest frequency, of the shorter of both waves
_MOST_NODES = 40_000
_MOST_MODES = 3000
_PEAK = 0.9  # of full scale, for the loudest sample of all that are compared
_FULL_SCALE = 32767
_WHOLE = 480  # samples: a whole number of steps


@dataclass(frozen=True)
class SoundPressure:
    """Sound pressure at a point, from the start of a run on.

    Attributes:
        pressure_pa: samples, shape (samples,), Pa.
        rate_hz: samples per second of simulated time.
    """

    pressure_pa: np.ndarray
    rate_hz: float

    @property
    def peak_pa(self) -> float:
        """Largest pressure."""
        return float(np.max(np.abs(self.pressure_pa), initial=0.0))

    @property
    def exposure_pa2_s(self) -> float:
        """Integral of the squared pressure."""
        return float(np.sum(self.pressure_pa**2)) / self.rate_hz


def radiator_of(setup: Setup) -> Radiator:
    """The modes of a scene's plate up to 20 kHz, on a grid fine enough for them.

    Raises SceneError for a structure without shapes.
    """
    spec = setup.plant
    limit_hz = _limit_hz(setup)
    omega_max = 2.0 * math.pi * limit_hz
    structure = spec.plate
    if structure.modes_below(limit_hz) > MOST_MODES:
        raise _too_many(structure.modes_below(limit_hz), limit_hz)
    modes = structure.modes(omega_max, spec.contact_point_m, spec.actuator_point_m)
    if structure.mode_table is not None:
        x, y, shapes = _of_file(structure.mode_table, omega_max)
    elif structure.size_m is None:
        raise SceneError(f"nothing can be heard of {structure}, which has no shapes on a grid")
    else:
        size = setup.size_m or (1.0, 1.0)
        x, y = (_midpoints(length, _spacing(structure, omega_max)) for length in size)
        shapes = structure.on_grid(omega_max, x, y)
    cell = np.outer(_widths(x), _widths(y)).ravel()
    moved = np.maximum(abs(modes.at_contact), abs(modes.at_actuator)) > modes.silent_below
    if np.count_nonzero(moved) > _MOST_MODES:
        raise _too_many(float(np.count_nonzero(moved)), limit_hz)
    xx, yy = np.meshgrid(x, y, indexing="ij")
    return Radiator(
        omega=modes.omega[moved],
        eta=(modes.eta + radiation_loss(structure, modes.omega))[moved],
        scale_per_kg=modes.scale_per_kg,
        at_contact=modes.at_contact[moved],
        at_actuator=modes.at_actuator[moved],
        shapes=shapes.reshape(len(modes.omega), -1)[moved],
        places_m=np.stack([xx.ravel(), yy.ravel()], axis=1),
        area_m2=cell,
    )


def _too_many(modes: float, limit_hz: float) -> SceneError:
    return SceneError(
        f"about {modes:.4g} modes below {limit_hz:.3g} Hz radiate; the limit is "
        f"{_MOST_MODES}. Use a "
        "smaller or stiffer plate"
    )


def radiation_loss(structure: Structure, omega: np.ndarray) -> np.ndarray:
    """Loss factors by what modes radiate, (modes,): a plate that rings on as in a vacuum radiates
    more than it was given. Zero for what is no simply supported plate, whose efficiencies are not
    known."""
    if structure.separable is None:
        return np.zeros(len(omega))
    return air_loss_factor(structure.separable, omega / (2.0 * math.pi))


def _of_file(table: ModeTable, omega_max: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if table.grid is None:
        raise SceneError(
            "the file of plate.modes has no shapes on a grid, without which nothing can be heard; "
            "add the arrays x_m, y_m and shape_grid to an .npz file"
        )
    x, y, shapes = table.grid
    below = table.omega_rad_s <= omega_max
    per_mass = table.per_modal_mass_1_kg[below]
    same = bool(len(per_mass)) and bool(np.all(per_mass == per_mass[0]))
    scale = 1.0 if same else np.sqrt(per_mass)[:, None, None]
    return x, y, shapes[below] * scale


def _spacing(structure: Structure, omega_max: float) -> float:
    """Distance of nodes: a share of the shortest wave in the plate or in the air, m."""
    plate = structure.local_plate
    air = 2.0 * math.pi * SOUND_SPEED_M_S / omega_max
    if plate is None:
        return air / _NODES_A_WAVE
    speed = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2)
    return min(air, 2.0 * math.pi * math.sqrt(speed / omega_max)) / _NODES_A_WAVE


def _midpoints(length: float, spacing: float) -> np.ndarray:
    count = min(max(8, math.ceil(length / spacing)), round(math.sqrt(_MOST_NODES)))
    return (np.arange(count) + 0.5) * (length / count)


def _widths(x: np.ndarray) -> np.ndarray:
    """What each place of an axis stands for, m."""
    inner = 0.5 * (x[1:] + x[:-1])
    first, last = 1.5 * x[0] - 0.5 * x[1], 1.5 * x[-1] - 0.5 * x[-2]
    return np.diff(np.concatenate([[first], inner, [last]]))


def drive_of(setup: Setup, blocks: Iterable[Block]) -> Excitation:
    """Forces on the plate from truth in blocks. Raises SceneError for a run that explodes."""
    contact, actuator = np.zeros(setup.steps), np.zeros(setup.steps)
    at = 0
    for _, forces in force_blocks(setup.plant, blocks):
        end = min(at + forces.shape[1], setup.steps)
        contact[at:end], actuator[at:end] = forces[0, : end - at], forces[2, : end - at]
        at = end
    if not (np.isfinite(contact).all() and np.isfinite(actuator).all()):
        raise SceneError("the run has numbers that are not finite; there is nothing to hear")
    return Excitation(contact[:at], actuator[:at], setup.step_s)


def grid_of(setup: Setup, tail_s: float, slow: float = 1.0) -> Grid:
    """Samples from the start of a run to `tail_s` after its end: so many that they sound at RATE_HZ
    when played `slow` times slower."""
    step_s = 1.0 / (RATE_HZ * slow)
    steps = math.ceil((setup.duration_s + tail_s) / step_s / _WHOLE) * _WHOLE
    # The band fades out above all modes that sound: else it would take from their energy.
    up_to = min(_limit_hz(setup) / FADE_FROM, 0.45 / step_s)
    return Grid(steps, step_s, up_to)


def listen(setup: Setup, drive: Excitation, listener_m: np.ndarray, grid: Grid) -> SoundPressure:
    """Sound pressure of a run at a point."""
    found = pressure_pa(radiator_of(setup), drive, listener_m, grid)
    return SoundPressure(found, 1.0 / grid.step_s)


@dataclass(frozen=True)
class Radiated:
    """Sound energy of a run, J: through a half sphere far away within the grid's time; in that time
    by each mode's own efficiency, and by mean ones, which are what damps the modes; by these until
    the plate is at rest."""

    sound_energy_j: float
    by_modes_j: float
    by_means_j: float
    until_rest_j: float


def radiated(setup: Setup, drive: Excitation, grid: Grid) -> Radiated | None:
    """The sound energy of a run; None for what is no simply supported plate."""
    spec = setup.plant
    plate = spec.plate.separable
    if plate is None:
        return None
    radiator = radiator_of(setup)
    m, n, _ = plate.mode_numbers(2.0 * math.pi * _limit_hz(setup))
    points = (spec.contact_point_m, spec.actuator_point_m)
    kept = np.max([abs(plate.mode_shape(m, n, at)) for at in points], axis=0) > NO_PARTICIPATION
    m, n = m[kept], n[kept]
    x, y = (np.unique(radiator.places_m[:, axis]) for axis in (0, 1))
    products = Products(
        np.sin(np.outer(m, x) * (np.pi / plate.size_m[0])),
        x,
        np.sin(np.outer(n, y) * (np.pi / plate.size_m[1])),
        y,
    )
    taken_j, held_j = rung_j(radiator, drive, grid)
    frequency_hz = radiator.omega / (2.0 * math.pi)

    def own(plate: Plate, frequency_hz: np.ndarray) -> np.ndarray:
        each = zip(m.tolist(), n.tolist(), frequency_hz.tolist(), strict=True)
        return np.array([efficiency_wallace(plate, *mode) for mode in each])

    mean = air_loss_factor(plate, frequency_hz)
    by_means_j = float(mean @ taken_j)
    return Radiated(
        radiated_j(radiator, products, drive, grid),
        float(air_loss_factor(plate, frequency_hz, by=own) @ taken_j),
        by_means_j,
        by_means_j + float((mean / radiator.eta) @ held_j),
    )


def _limit_hz(setup: Setup) -> float:
    """Up to where modes sound."""
    return min(RADIATED_UP_TO_HZ, setup.plant.frequency_limit_hz)


def write_wavs(sounds: dict[Path, SoundPressure]) -> float:
    """Write 16 bit files on one scale; the pressure that is full scale, Pa (0 for silence)."""
    loudest = max(one.peak_pa for one in sounds.values())
    full_pa = loudest / _PEAK
    for path, one in sounds.items():
        share = one.pressure_pa / full_pa if full_pa > 0.0 else one.pressure_pa
        samples = np.round(np.clip(share, -1.0, 1.0) * _FULL_SCALE).astype("<i2")
        with wave.open(sound := BytesIO(), "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(2)
            file.setframerate(RATE_HZ)
            file.writeframes(samples.tobytes())
        atomic_write(path, sound.getvalue())
    return full_pa


def write_sounds(
    recording: Recording,
    setup: Setup,
    folder: Path,
    at: tuple[float, float, float],
    slow: float,
    tail_s: float,
    energy: bool = False,
) -> dict[str, Any]:
    """Write the sound of a recording as WAV files, with and without control.

    Args:
        recording: The recording.
        setup: The setup of the run.
        folder: The folder for the files.
        at: The listener, from the plate centre: x, y and height, m.
        slow: Factor by which the sound is slowed down.
        tail_s: Time after the run, s.
        energy: Whether to compute the radiated energies as well.

    Returns:
        Files, levels and energies by run, as `listen --json` writes them.

    Raises:
        RecordingError: The recording cannot be used.
        SceneError: The structure has no shapes on a grid, or the run is not finite.
        OSError: A file cannot be written.
    """
    if (step := missing_from(recording, setup)) is not None:
        raise RecordingError(
            f"{recording.path}: step {step} is missing. The sound follows from all steps of a run."
        )
    grid = grid_of(setup, tail_s, slow)
    size = setup.size_m or (0.0, 0.0)
    place = np.array([0.5 * size[0] + at[0], 0.5 * size[1] + at[1], at[2]])
    recorded = pieces_of(recording)
    runs: dict[str, Iterable[Block]] = {"without-control": recorded}
    if setup.has_law:
        free = free_series(setup.without_control())
        runs = {"with-control": recorded, "without-control": free}
    sounds: dict[Path, SoundPressure] = {}
    data: dict[str, Any] = {"at_m": list(at), "slow": slow, "tail_s": tail_s, "runs": {}}
    for name, blocks in runs.items():
        path = folder / f"{recording.path.stem}-{name}.wav"
        drive = drive_of(setup, blocks)
        sounds[path] = listen(setup, drive, place, grid)
        data["runs"][name] = {
            "file": str(path),
            "peak_pa": sounds[path].peak_pa,
            "exposure_pa2_s": sounds[path].exposure_pa2_s,
            "level_db": _level(sounds[path].exposure_pa2_s),
        }
        if energy:
            found = radiated(setup, drive, grid)
            data["runs"][name] |= asdict(found) if found else {}
    data["full_scale_pa"] = write_wavs(sounds)
    return data


def _level(exposure_pa2_s: float) -> float:
    """Sound exposure level, dB re (20 uPa)^2 1 s."""
    return 10.0 * math.log10(exposure_pa2_s / 4e-10) if exposure_pa2_s > 0.0 else -math.inf
