"""Deflection of the whole plate, worked out again from the recorded forces.

Every mode is propagated exactly with the forces held over a step, as in the plant, but
modes of equal frequency are kept apart: their shapes differ away from the contact.
"""

import math
from collections.abc import Sequence

import numpy as np

from hertzloop.plant.numerics import damped_frequency
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.structures.linear import Poles, deflections, linear_of
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1, V_P, XI_A
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay.contacts import ContactSpan, contacts_of
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import Setup

NODES = 1681  # of the grid, about
_MOST_MODES = 32_000  # those beyond matter next to the contact, and only while it lasts
_FLAT_RADII = 12.0  # of the sphere, from the contact to the edge of what has no shapes
_FLAT_M = 0.1  # the same distance, where a soft tip has no radius
_FIRST_FRAMES = 360  # around the first contact
_LATER_FRAMES = 150  # around all later contacts
_CONTACT_FRAMES = 5  # around one of them, at least
_COARSE_FRAMES = 150  # over the whole run
_AFTER = 10  # of the first contact's length, for waves to run to the edge and back


def forces_on_plate(spec: PlantSpec, truth: np.ndarray) -> np.ndarray:
    """Forces up on the plate by truth, shape (4, steps): at the contact, at the actuator,
    each its mean over a step and its slope. A mass on the plate pushes back by its inertia."""
    forces = np.stack([-truth[F_C], -truth[F_C1], truth[F_A], truth[F_A1]])
    mass_kg = spec.actuator.mass_kg
    if mass_kg > 0.0 and truth.shape[1] > 1:
        same = spec.same_point
        speed = truth[V_P] if same else np.gradient(truth[XI_A], spec.step_s)
        forces[2, :-1] -= mass_kg * np.diff(speed) / spec.step_s
    return forces


def _moved(
    spec: PlantSpec, omega_max: float, forces: np.ndarray, frames: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return which modes up to a frequency (rad/s) a force moves, and the deflection of these,
    (frames, modes), under forces on the plate, (4, steps), at the frames that they reach."""
    modes = spec.plate.modes(omega_max, spec.contact_point_m, spec.actuator_point_m)
    shapes = np.stack([modes.at_contact, modes.at_actuator])
    moved = np.flatnonzero(abs(shapes).max(axis=0) > modes.silent_below)
    eta = np.broadcast_to(modes.eta, modes.omega.shape)[moved]
    theta, rho = damped_frequency(modes.omega[moved], eta)
    drive = modes.scale_per_kg * shapes[:, moved] + 0j
    none = np.zeros((0, len(moved)))
    poles = Poles((1j - rho) * theta, drive, none + 0j, np.zeros((3, len(moved))))
    linear = linear_of(poles, spec.step_s)
    z = np.zeros_like(linear.turn)
    found = np.zeros((len(frames), z.shape[1]))
    deflections(linear, z, np.ascontiguousarray(forces), 0, frames, found)
    return moved, found[:, : len(moved)] / theta


def frame_steps(steps: int, contacts: Sequence[ContactSpan]) -> np.ndarray:
    """Steps of a run of so many at which a frame is worth its memory, ascending: at most about 660.

    Dense from shortly before the first contact to ten times its length after it, less so
    around later ones, coarse elsewhere.
    """
    spans = [(0, steps, _COARSE_FRAMES)]
    for one in contacts[:1]:
        length = one.end - one.first
        spans.append((one.first - length, one.end + _AFTER * length, _FIRST_FRAMES))
    later = contacts[1:]
    each = max(_CONTACT_FRAMES, _LATER_FRAMES // max(len(later), 1))
    for one in later[:: max(1, -(-len(later) * each // _LATER_FRAMES))]:
        length = one.end - one.first
        spans.append((one.first - length, one.end + length, each))
    found = [np.linspace(a, b - 1, min(count, b - a)).astype(np.int64) for a, b, count in spans]
    frames = np.unique(np.concatenate(found))
    return frames[(frames >= 0) & (frames < steps)]


def _axis(length_m: float, node_m: float, count: int) -> np.ndarray:
    """About `count` coordinates from 0 to the length, one of them exactly at `node_m`."""
    before = min(max(round(count * node_m / length_m), 1), count - 2)
    left = np.linspace(0.0, node_m, before + 1)
    return np.concatenate([left, np.linspace(node_m, length_m, count - before)[1:]])


def _grid(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Return the axes of a grid whose nodes include the contact point, or those of the structure's
    own; a small one around the contact where there are no shapes."""
    spec, structure = setup.plant, setup.plant.plate
    if structure.grid_m is not None:
        return structure.grid_m
    point_m = spec.contact_point_m
    if not structure.has_shapes:
        radius_m = spec.sphere.radius_m
        size_m = _FLAT_M if math.isnan(radius_m) else _FLAT_RADII * radius_m
        flat = size_m * np.array([-1.0, 0.0, 1.0])
        return point_m[0] + flat, point_m[1] + flat
    size = setup.scene.plate.size_m or (1.0, 1.0)
    side = math.sqrt(NODES / (size[0] * size[1]))
    x, y = (
        _axis(length, at, max(5, round(side * length)))
        for length, at in zip(size, point_m, strict=True)
    )
    return x, y


def deflection(
    setup: Setup,
    recording: Recording,
    frames: np.ndarray | None = None,
    contacts: Sequence[ContactSpan] | None = None,
) -> Deflection:
    """Deflection of the plate at the steps `frames` (default: `frame_steps`) of a recording;
    `contacts` if they are known. A structure without shapes stays flat.

    Raises SceneError if the recorded scene cannot be simulated.
    """
    spec, truth = setup.plant, recording.truth
    if frames is None:
        found = contacts_of(truth) if contacts is None else contacts
        frames = frame_steps(truth.samples, found)
    forces = forces_on_plate(spec, truth_of(recording))
    frames = frames[frames < forces.shape[1]]
    (x, y), structure = _grid(setup), spec.plate
    w = np.zeros((len(frames), len(x), len(y)))
    if structure.has_shapes:
        limit_hz = spec.frequency_limit_hz
        limit_hz *= min(1.0, _MOST_MODES / max(structure.modes_below(limit_hz), 1.0))
        omega_max = 2.0 * math.pi * limit_hz
        moved, states = _moved(spec, omega_max, forces, frames)
        for i in range(len(x)):  # all shapes at once may not fit into the memory
            w[:, i] = states @ structure.on_grid(omega_max, x[i : i + 1], y)[moved, 0]
    times_ns = frames * truth.step_ns
    return Deflection(times_ns, x, y, w, spec.contact_point_m, structure.has_shapes)
