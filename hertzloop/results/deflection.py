"""Deflection of the whole plate, worked out again from the recorded forces.

Every mode is propagated exactly with the forces held over a step, as in the plant, but
modes of equal frequency are kept apart: their shapes differ away from the contact.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.plant.numerics import damped_frequency
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.structures.linear import Linear, Poles, deflections, linear_of
from hertzloop.plant.structures.mode_file import ModeTable
from hertzloop.plant.structures.modes import Modes
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1, V_P, XI_A
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay.contacts import ContactSpan, Span, contacts_of
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import Setup

NODES = 1681  # of the grid, about
MODES_PER_AXIS = 160  # at most; all modes of the shipped scenes
_MOST_MODES = 4000  # of a plate with other edges than simply supported ones
_FLAT_RADII = 12.0  # of the sphere, from the contact to the edge of what has no shapes
_FLAT_M = 0.1  # the same distance, where a soft tip has no radius
_FIRST_FRAMES = 360  # around the first contact
_LATER_FRAMES = 150  # around all later contacts
_COARSE_FRAMES = 150  # over the whole run
_AFTER = 10.0  # of the first contact's length, for waves to run to the edge and back


@dataclass(frozen=True)
class PlateModes:
    """Modes of what is struck, as poles, and their shapes.

    Attributes:
        shapes: along x (places, modes along x) and along y (modes along y, places) where they are
            products of sines, else one array (modes, x, y).
        moves: the modes that the plant has, of all, bool, (modes along x, modes along y) or
            (modes,).
        linear: those from step to step, under forces at the contact and at the actuator.
        theta: their frequencies, rad/s: z of a mode displaces it by Im z/theta.
    """

    shapes: tuple[np.ndarray, ...]
    moves: np.ndarray
    linear: Linear
    theta: np.ndarray


def _taking_part(numbers: np.ndarray, *shares: float) -> np.ndarray:
    """Mode numbers along one axis whose shape is not zero at all points (0..1 along it)."""
    largest = np.max([abs(np.sin(numbers * np.pi * share)) for share in shares], axis=0)
    return numbers[largest > 1e-9]


def _plate_modes(spec: PlantSpec, modes: Modes, shapes: tuple[np.ndarray, ...]) -> PlateModes:
    """Modes that move as the plant's do; those above its limit stay at rest."""
    moves = modes.omega <= 2.0 * np.pi * spec.frequency_limit_hz
    eta = np.broadcast_to(modes.eta, modes.omega.shape)[moves]
    theta, rho = damped_frequency(modes.omega[moves], eta)
    drive = [modes.scale_per_kg * shape[moves] for shape in (modes.at_contact, modes.at_actuator)]
    none = np.zeros((0, len(theta)))
    poles = Poles(
        (1j - rho) * theta, np.array(drive, complex), none + 0j, np.zeros((3, len(theta)))
    )
    return PlateModes(shapes, moves, linear_of(poles, spec.step_s), theta)


def _supported_modes(spec: PlantSpec, x_m: np.ndarray, y_m: np.ndarray) -> PlateModes:
    """Modes of a simply supported plate with both numbers up to MODES_PER_AXIS."""
    plate = spec.simply_supported
    numbers = np.arange(1, MODES_PER_AXIS + 1)
    points = (spec.contact_point_m, spec.actuator_point_m)
    m, n = (
        _taking_part(numbers, *(p[axis] / plate.size_m[axis] for p in points)) for axis in (0, 1)
    )
    mm, nn = np.meshgrid(m, n, indexing="ij")
    wave_number = (mm * np.pi / plate.size_m[0]) ** 2 + (nn * np.pi / plate.size_m[1]) ** 2
    omega = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2) * wave_number
    modes = Modes(
        omega,
        np.full_like(omega, plate.eta),
        plate.modal_scale_per_kg,
        plate.mode_shape(mm, nn, points[0]),
        plate.mode_shape(mm, nn, points[1]),
    )
    shapes = (
        np.sin(np.outer(x_m, m) * np.pi / plate.size_m[0]),
        np.sin(np.outer(n, y_m) * np.pi / plate.size_m[1]),
    )
    return _plate_modes(spec, modes, shapes)


def _edged_modes(spec: PlantSpec, x_m: np.ndarray, y_m: np.ndarray) -> PlateModes:
    """The lower modes of what has shapes of its own."""
    plate, limit = spec.plate, 2.0 * np.pi * spec.frequency_limit_hz
    modes = plate.modes(limit, spec.contact_point_m, spec.actuator_point_m)
    if len(modes.omega) > _MOST_MODES:
        limit = float(modes.omega[_MOST_MODES - 1])
        modes = plate.modes(limit, spec.contact_point_m, spec.actuator_point_m)
    moved = np.maximum(abs(modes.at_contact), abs(modes.at_actuator)) > modes.silent_below
    moving = replace(
        modes,
        omega=modes.omega[moved],
        at_contact=modes.at_contact[moved],
        at_actuator=modes.at_actuator[moved],
    )
    return _plate_modes(spec, moving, (plate.on_grid(limit, x_m, y_m)[moved],))


def _flat_grid(spec: PlantSpec) -> tuple[np.ndarray, np.ndarray]:
    """A small grid around the contact, (3,) and (3,), for what has no shapes."""
    radius_m = spec.sphere.radius_m
    size_m = _FLAT_M if math.isnan(radius_m) else _FLAT_RADII * radius_m
    flat = size_m * np.array([-1.0, 0.0, 1.0])
    return spec.contact_point_m[0] + flat, spec.contact_point_m[1] + flat


def _modes_of_file(spec: PlantSpec, table: ModeTable, shapes: np.ndarray) -> PlateModes:
    """Modes of a file, with their shapes on its grid."""
    mass = np.sqrt(table.per_modal_mass_1_kg)
    at_contact, at_actuator = mass * table.shape_contact, mass * table.shape_actuator
    modes = Modes(table.omega_rad_s, table.loss_factor, 1.0, at_contact, at_actuator)
    return _plate_modes(spec, modes, (mass[:, None, None] * shapes,))


def _grid_and_modes(
    setup: Setup,
) -> tuple[np.ndarray, np.ndarray, PlateModes] | None:
    """Return the grid of a structure, and its modes; None for one without shapes."""
    spec, structure = setup.plant, setup.plant.plate
    if structure.mode_table is not None:
        grid = structure.mode_table.grid
        if grid is None:
            return None
        return *grid[:2], _modes_of_file(spec, structure.mode_table, grid[2])
    if not structure.has_shapes:
        return None
    x, y = axes(setup.scene.plate.size_m or (1.0, 1.0), spec.contact_point_m, NODES)
    supported = structure.simply_supported is not None
    return x, y, (_supported_modes if supported else _edged_modes)(spec, x, y)


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


def _states(modes: PlateModes, forces: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Deflection of every mode at the steps `frames` (ascending), shape (frames, *modes), under
    forces on the plate, shape (4, steps); of those frames that the forces reach."""
    z = np.zeros_like(modes.linear.turn)
    frames = frames[frames < forces.shape[1]]
    moved = np.zeros((len(frames), z.shape[1]))
    deflections(modes.linear, z, np.ascontiguousarray(forces), 0, frames, moved)
    found = np.zeros((len(frames), *modes.moves.shape))
    found[:, modes.moves] = moved[:, : len(modes.theta)] / modes.theta
    return found


def frame_steps(steps: int, contacts: Sequence[Span]) -> np.ndarray:
    """Steps of a run of so many at which a frame is worth its memory, ascending: at most about 600.

    Dense from shortly before the first contact to ten times its length after it, less so
    around later ones, coarse elsewhere.
    """
    frames = [np.linspace(0, steps - 1, min(steps, _COARSE_FRAMES)).astype(np.int64)]
    if contacts:
        start, end = contacts[0]
        first = max(0, start - (end - start))
        last = min(steps, end + int(_AFTER * (end - start)))
        frames.append(np.arange(first, last, -(-(last - first) // _FIRST_FRAMES)))
    if contacts[1:]:
        frames.append(_spread(steps, np.array(contacts[1:], np.int64)))
    return np.unique(np.concatenate(frames))


def _spread(steps: int, contacts: np.ndarray) -> np.ndarray:
    """At most _LATER_FRAMES steps evenly over contacts (contacts, 2) and as much around each."""
    length = contacts[:, 1] - contacts[:, 0]
    begins = np.maximum(contacts[:, 0] - length, 0)
    ends = np.minimum(contacts[:, 1] + length, steps)
    begins[1:] = np.maximum(begins[1:], np.maximum.accumulate(ends)[:-1])  # each step once
    before = np.cumsum(np.maximum(ends - begins, 0))
    picked = np.arange(0, before[-1], -(-before[-1] // _LATER_FRAMES))
    of = np.searchsorted(before, picked, "right")
    return np.asarray(ends[of] - (before[of] - picked))


def _axis(length_m: float, node_m: float, count: int) -> np.ndarray:
    """About `count` coordinates from 0 to the length, one of them exactly at `node_m`."""
    before = min(max(round(count * node_m / length_m), 1), count - 2)
    left = np.linspace(0.0, node_m, before + 1)
    return np.concatenate([left, np.linspace(node_m, length_m, count - before)[1:]])


def axes(
    size_m: tuple[float, float], point_m: tuple[float, float], nodes: int
) -> tuple[np.ndarray, np.ndarray]:
    """Axes of a grid of about `nodes` nodes, one of them at a point."""
    side = math.sqrt(nodes / (size_m[0] * size_m[1]))
    x, y = (
        _axis(length, at, max(5, round(side * length)))
        for length, at in zip(size_m, point_m, strict=True)
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

    Modes beyond MODES_PER_AXIS along an axis (or _MOST_MODES) are left out: they matter next to the
    contact, and only while it lasts. Raises SceneError if the recorded scene cannot be simulated.
    """
    spec, truth = setup.plant, recording.truth
    if frames is None:
        found = contacts_of(truth) if contacts is None else contacts
        frames = frame_steps(truth.samples, [(one.first, one.end) for one in found])
    shaped = _grid_and_modes(setup)
    if shaped is None:
        times_ns, flat = frames * truth.step_ns, np.zeros((len(frames), 3, 3))
        return Deflection(times_ns, *_flat_grid(spec), flat, spec.contact_point_m, False)
    x, y, modes = shaped
    states = _states(modes, forces_on_plate(spec, truth_of(recording)), frames)
    if len(modes.shapes) == 2:
        w = modes.shapes[0] @ states @ modes.shapes[1]
    else:
        w = np.tensordot(states, modes.shapes[0], 1)
    times_ns = frames[: len(states)] * truth.step_ns
    return Deflection(times_ns, x, y, w, spec.contact_point_m, True)
