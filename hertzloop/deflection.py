"""Deflection of the whole plate, worked out again from the recorded forces.

Every mode is propagated exactly with the forces held over a step, as in the plant, but
modes of equal frequency are kept apart: their shapes differ away from the contact.
"""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop import parts
from hertzloop.scene import Scene
from plant.phi import phi
from plant.plant import PlantSpec
from recordings.reader import Recording
from recordings.replay_data import Deflection, contact_spans

NODES = 2401  # of the grid, about
MODES_PER_AXIS = 160  # at most; all modes of the shipped scenes
_PIECE = 64  # steps under force that are advanced at once
_FIRST_FRAMES = 360  # around the first contact
_LATER_FRAMES = 150  # around all later contacts
_COARSE_FRAMES = 150  # over the whole run
_AFTER = 10.0  # of the first contact's length, for waves to run to the edge and back


@dataclass(frozen=True)
class Modes:
    """Modes m x n of the plate; arrays have the shape (modes along x, modes along y).

    z is one complex number a mode: its deflection is Im z, a step turns it by `turn`, and a
    unit modal force held over the step adds `grown`, one that rises from -1 to 1 over it
    `grown_1`. `powers` holds turn^0 .. turn^_PIECE.
    """

    m: np.ndarray
    n: np.ndarray
    s_step: np.ndarray  # exponent of one step
    grown: np.ndarray
    grown_1: np.ndarray
    at_contact: np.ndarray
    at_actuator: np.ndarray
    powers: np.ndarray


def _taking_part(numbers: np.ndarray, *shares: float) -> np.ndarray:
    """Mode numbers along one axis whose shape is not zero at all points (0..1 along it)."""
    largest = np.max([abs(np.sin(numbers * np.pi * share)) for share in shares], axis=0)
    return numbers[largest > 1e-9]


def modes_of(spec: PlantSpec, per_axis: int = MODES_PER_AXIS) -> Modes:
    """Modes with both numbers up to `per_axis` that the plant simulated too."""
    plate, h = spec.plate, spec.step_s
    numbers = np.arange(1, per_axis + 1)
    points = (spec.contact_point_m, spec.actuator_point_m)
    m, n = (
        _taking_part(numbers, *(p[axis] / plate.size_m[axis] for p in points)) for axis in (0, 1)
    )
    mm, nn = np.meshgrid(m, n, indexing="ij")
    wave_number = (mm * np.pi / plate.size_m[0]) ** 2 + (nn * np.pi / plate.size_m[1]) ** 2
    omega = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2) * wave_number
    root = math.sqrt(1.0 - plate.eta**2 / 4.0)
    theta = omega * root
    s = theta * (1j - plate.eta / (2.0 * root))
    grown = plate.modal_scale_per_kg / theta * np.expm1(s * h) / s
    x = s * h
    grown_1 = plate.modal_scale_per_kg / theta * h * x * (2.0 * phi(3, x) - phi(2, x))
    for by in (grown, grown_1):
        by[omega > 2.0 * np.pi * spec.frequency_limit_hz] = 0.0
    exponents = np.arange(_PIECE + 1)[:, None, None] * (s * h)
    return Modes(
        m, n, s * h, grown, grown_1,
        plate.mode_shape(mm, nn, points[0]), plate.mode_shape(mm, nn, points[1]),
        np.exp(exponents),
    )  # fmt: skip


def _under_force(
    modes: Modes, z: np.ndarray, f_c: np.ndarray, f_c1: np.ndarray, f_a: np.ndarray
) -> np.ndarray:
    """z after len(f_c) <= _PIECE steps under these forces."""
    count = len(f_c)
    turned = modes.powers[:count][::-1]
    by_contact = np.tensordot(f_c, turned, 1)
    by_actuator = np.tensordot(f_a, turned, 1)
    drive = modes.at_actuator * by_actuator - modes.at_contact * by_contact
    tilt = modes.at_contact * np.tensordot(f_c1, turned, 1)
    return np.asarray(z * modes.powers[count] + modes.grown * drive - modes.grown_1 * tilt)


def _states(
    modes: Modes, f_c: np.ndarray, f_c1: np.ndarray, f_a: np.ndarray, frames: np.ndarray
) -> np.ndarray:
    """Deflection of every mode at the steps `frames` (ascending), shape (frames, m, n)."""
    forced = np.flatnonzero((f_c != 0.0) | (f_a != 0.0))
    z = np.zeros_like(modes.grown)
    found = np.empty((len(frames), *z.shape))
    step = 0
    for i, target in enumerate(frames):
        while step < target:
            following = np.searchsorted(forced, step)
            force_at = forced[following] if following < len(forced) else target
            if force_at > step:
                end = min(int(force_at), int(target))
                z = z * np.exp((end - step) * modes.s_step)
            else:
                end = min(step + _PIECE, int(target))
                z = _under_force(modes, z, f_c[step:end], f_c1[step:end], f_a[step:end])
            step = end
        found[i] = z.imag
    return found


def frame_steps(xi_m: np.ndarray) -> np.ndarray:
    """Steps at which a frame is worth its memory, ascending: at most about 600.

    Dense from shortly before the first contact to ten times its length after it, less so
    around later ones, coarse elsewhere.
    """
    steps, contacts = len(xi_m), contact_spans(xi_m)
    frames = [np.linspace(0, steps - 1, min(steps, _COARSE_FRAMES)).astype(np.int64)]
    if contacts:
        start, end = contacts[0]
        first = max(0, start - (end - start))
        last = min(steps, end + int(_AFTER * (end - start)))
        frames.append(np.arange(first, last, -(-(last - first) // _FIRST_FRAMES)))
    if contacts[1:]:
        around = [np.arange(max(0, 2 * a - b), min(2 * b - a, steps)) for a, b in contacts[1:]]
        later = np.unique(np.concatenate(around))
        frames.append(later[:: -(-len(later) // _LATER_FRAMES)])
    return np.unique(np.concatenate(frames))


def _axis(length_m: float, node_m: float, count: int) -> np.ndarray:
    """About `count` coordinates from 0 to the length, one of them exactly at `node_m`."""
    before = min(max(round(count * node_m / length_m), 1), count - 2)
    left = np.linspace(0.0, node_m, before + 1)
    return np.concatenate([left, np.linspace(node_m, length_m, count - before)[1:]])


def deflection(
    scene: Scene,
    recording: Recording,
    frames: np.ndarray | None = None,
    per_axis: int = MODES_PER_AXIS,
) -> Deflection:
    """Deflection of the plate at the steps `frames` (default: `frame_steps`) of a recording.

    Modes beyond `per_axis` along an axis are left out: they matter next to the contact, and
    only while it lasts. Raises SceneError if the recorded scene cannot be simulated.
    """
    spec = parts.plant_spec(scene)
    arrays = recording.truth.arrays
    xi, f_c, f_a = (arrays.get(name, np.zeros(0)) for name in ("xi_m", "f_c_n", "f_a_n"))
    f_c1 = arrays.get("f_c1_n", np.zeros(len(f_c)))
    if frames is None:
        frames = frame_steps(xi)
    modes = modes_of(spec, per_axis)
    (length_x, length_y), contact = spec.plate.size_m, spec.contact_point_m
    side = math.sqrt(NODES / (length_x * length_y))
    x = _axis(length_x, contact[0], max(5, round(side * length_x)))
    y = _axis(length_y, contact[1], max(5, round(side * length_y)))
    shape_x = np.sin(np.outer(x, modes.m) * np.pi / length_x)
    shape_y = np.sin(np.outer(modes.n, y) * np.pi / length_y)
    w = shape_x @ _states(modes, f_c, f_c1, f_a, frames) @ shape_y
    return Deflection(recording.truth.time_ns[frames], x, y, w, contact)
