"""Measured structures: modes from noisy responses of known scenes, and from hits.

No unbiased estimate has smaller standard deviations than the bound of Cramér and Rao. The bound
printed here takes as known how large the noise is and all that lies above the band.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import Columns, results_in
from hertzloop.cli.options import JsonOption
from hertzloop.fitting.modes.frequency_responses import FrequencyResponses, noise_weights
from hertzloop.fitting.modes.from_hits import modes_of_hits
from hertzloop.fitting.modes.from_responses import modes_of_responses
from hertzloop.fitting.modes.hit_responses import hits_of_records
from hertzloop.fitting.modes.response_rows import real_rows
from hertzloop.fitting.modes.universal_file import Points
from hertzloop.fitting.records.reading import read_record
from hertzloop.plant.structures.mode_file import ModeTable
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.setup import load

_NOISE = 1e-3  # of each value
_ACCELERATION = 2  # order of the derivative
_JUDGED_HZ = 5e3  # up to here
_TARGETS = {"frequency": 1e-5, "damping": 1e-2, "contact": 5e-3, "actuator": 5e-3}
_HAMMER = Path(__file__).resolve().parent.parent / "docs" / "examples" / "hammer"
# Scene, and distance of lines, Hz.
_CASES = (
    ("offcentre-6mm", 0.5),
    ("aluminium-3mm", 0.2),
    ("aluminium-3mm", 0.5),
    ("oak-20mm", 0.5),
)


@dataclass(frozen=True)
class Deviation:
    """Largest deviation of modes up to 5 kHz, relative: of frequency, loss factor, shape at the
    contact point and at the actuator, and the bound of their standard deviation in the same mode;
    `modes` in the band, and how many were `found`; how many modes have a bound `beyond` a target.
    """

    scene: str
    line_hz: float
    modes: int
    found: int
    frequency: float
    damping: float
    contact: float
    actuator: float
    frequency_bound: float
    damping_bound: float
    contact_bound: float
    actuator_bound: float
    beyond: int

    @property
    def case(self) -> str:
        """In a table."""
        return f"{self.scene}, {self.line_hz:g} Hz"


def response(table: ModeTable, hz: np.ndarray, shape: np.ndarray, order: int) -> np.ndarray:
    """Response at a point to a force at the contact point, (lines,), SI units."""
    w = 2.0 * np.pi * hz
    found = np.full(len(hz), (table.residual_flexibility_m_n or 0.0) + 0j)
    if shape is not table.shape_contact:
        found *= 0.0
    share = table.shape_contact * shape * table.per_modal_mass_1_kg
    loss = np.broadcast_to(table.loss_factor, share.shape)
    for omega, eta, one in zip(table.omega_rad_s, loss, share, strict=True):
        found += one / (omega**2 - w**2 + 1j * eta * omega * w)
    return found * (1j * w) ** order


def bounds(
    known: ModeTable,
    hz: np.ndarray,
    shapes: Sequence[np.ndarray],
    order: int,
    noise: Sequence[np.ndarray],
) -> np.ndarray:
    """Least standard deviations of unbiased estimates, relative: of frequencies, loss factors, and
    shapes at the contact and at the last point, (4, modes up to the last line).

    Args:
        shapes: those of the contact and the other points, (modes,) each.
        noise: standard deviation of each response, (lines,) each.
    """
    n = int(np.count_nonzero(known.omega_rad_s < 2.0 * np.pi * hz[-1]))
    s, omega = 2j * np.pi * hz, known.omega_rad_s[:n, None]
    damping = np.broadcast_to(known.loss_factor, known.omega_rad_s.shape)[:n, None] * omega
    of_unit = s**order / (omega**2 + s * (s + damping))
    triangles = []
    for i, (shape, size) in enumerate(zip(shapes, noise, strict=True)):
        share = known.shape_contact * shape * known.per_modal_mass_1_kg
        by = share[:n, None] * of_unit  # also the change with the logarithm of the residue
        slope = -by * of_unit / s**order
        mine = [np.zeros_like(by)] * len(shapes)
        mine[i] = by
        rows = np.concatenate([slope * (2.0 * omega**2 + s * damping), slope * s * damping, *mine])
        triangles.append(np.linalg.qr(np.sqrt(2.0) * real_rows(rows / size).T, mode="r"))
    matrix = np.concatenate(triangles)
    scale = np.linalg.norm(matrix, axis=0)
    inverse = np.linalg.inv(np.linalg.qr(matrix / scale, mode="r")) / scale[:, None]
    frequency, loss, own, *others = inverse.reshape(-1, n, inverse.shape[1])
    other = others[-1] - 0.5 * own if others else 0.5 * own
    return np.array([np.linalg.norm(one, axis=1) for one in (frequency, loss, 0.5 * own, other)])


def deviation(scene: str, line_hz: float, high_hz: float) -> Deviation:
    """Identify the modes of a scene from noisy accelerances."""
    known = modes_of_scene(load(scene))
    hz, rng = np.arange(5.0, high_hz, line_hz), np.random.default_rng(1)
    same = np.array_equal(known.shape_contact, known.shape_actuator)
    shapes = (known.shape_contact,) if same else (known.shape_contact, known.shape_actuator)
    values, noises = [], []
    for shape in shapes:
        exact = response(known, hz, shape, _ACCELERATION)
        parts = rng.standard_normal((2, len(hz))) / np.sqrt(2.0)
        noises.append(_NOISE * np.abs(exact))
        values.append(exact + noises[-1] * (parts[0] + 1j * parts[1]))
    points = Points(1) if same else Points(1, 2)
    measured = FrequencyResponses(
        hz,
        np.array(values),
        np.array([noise_weights(one) for one in values]),
        _ACCELERATION,
        tuple(range(1, 1 + len(values))),
        1,
        "z",
    )
    table = modes_of_responses(measured, None, points, lambda *_: None).table
    below = known.omega_rad_s < 2.0 * np.pi * min(_JUDGED_HZ, high_hz)
    loss = np.broadcast_to(known.loss_factor, known.omega_rad_s.shape)
    mass, sign = np.sqrt(known.per_modal_mass_1_kg[below]), np.sign(known.shape_contact[below])
    nearest = [
        int(np.argmin(np.abs(table.omega_rad_s / omega - 1.0)))
        for omega in known.omega_rad_s[below]
    ]
    pairs = (
        (table.omega_rad_s, known.omega_rad_s[below]),
        (table.loss_factor, loss[below]),
        (table.shape_contact, mass * np.abs(known.shape_contact[below])),
        (table.shape_actuator, mass * sign * known.shape_actuator[below]),
    )
    apart = np.array([np.abs(found[nearest] / true - 1.0) for found, true in pairs])
    worst = np.argmax(apart, axis=1)
    least = bounds(known, hz, shapes, _ACCELERATION, noises)[:, : len(nearest)]
    numbers: dict[str, Any] = {}
    for name, mode, found, bound in zip(_TARGETS, worst, apart, least, strict=True):
        numbers |= {name: float(found[mode]), f"{name}_bound": float(bound[mode])}
    return Deviation(
        scene,
        line_hz,
        modes=int(np.count_nonzero(known.omega_rad_s < 2.0 * np.pi * high_hz)),
        found=len(table.omega_rad_s),
        beyond=int(np.count_nonzero(np.any(list(_TARGETS.values()) < least.T, axis=1))),
        **numbers,
    )


def _numbers(suffix: str = "") -> Columns:
    """Columns of all quantities, or of their bounds."""
    return {name: f"{{.{name}{suffix}:.1e}}" for name in _TARGETS}


def main(
    out_dir: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Identify modes from noisy frequency responses of shipped scenes, and predict each shipped
    hit of a hammer by the others.

    Example: python -m benchmarks.measured_modes --quick
    """
    with results_in(out_dir, "measured-modes", json_file=json_file) as results:
        cases, high_hz = (_CASES[:1], 2e3) if quick else (_CASES, 6e3)
        found = [deviation(*case, high_hz) for case in tracked("responses", cases)]
        results.write("responses", found)
        judged = f"modes up to {_JUDGED_HZ / 1e3:g} kHz, noise {_NOISE:g}"
        case = {"case": "{.case}"}
        results.table(
            f"largest deviation of {judged}",
            {**case, "modes": "{.modes}", "found": "{.found}", **_numbers()},
            found,
        )
        results.table(
            f"bound of the standard deviation in the same mode; {judged}",
            {**case, **_numbers("_bound"), "modes beyond a target": "{.beyond}"},
            found,
        )
        records = [read_record(_HAMMER / f"{kind}{i}.csv") for i in (1, 2, 3) for kind in "fa"]
        hits = modes_of_hits(hits_of_records(records), [], False, lambda *_: None).held_out
        results.table(
            "hits predicted by the other two, first 40 ms",
            {
                "hit": "{.name}",
                "modes": "{.modes}",
                "error/rms, %": lambda one: f"{100 * one.rms:.2f}",
                "largest error/peak, %": lambda one: f"{100 * one.peak:.2f}",
            },
            hits,
        )
        within = [
            one
            for one in found
            if all(getattr(one, name) <= target for name, target in _TARGETS.items())
        ]
        barred = sum(one.beyond > 0 for one in found if one not in within)
        results.conclude(
            f"Modes are within all targets in {len(within)} of {len(found)} cases; in {barred} of "
            "the others no unbiased estimate has standard deviations within the targets."
        )


if __name__ == "__main__":
    start("benchmarks.measured_modes")
