"""Measured structures: modes from noisy responses of known scenes, held-out hits, and few modes."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    check_json,
    conclude,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    written,
)
from hertzloop.analysis.deflection import modes_of_scene
from hertzloop.analysis.impacts import consistent_impacts
from hertzloop.loop.compiled import simulate
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.structures.mode_file import ModeTable, write_modes
from hertzloop.setup import Setup, load, model_error
from hertzloop.studies import pictures
from hertzloop.studies.fit.records import read_record
from hertzloop.studies.modal.hits import hits_of_records
from hertzloop.studies.modal.modes import modes_of_hits, modes_of_responses
from hertzloop.studies.modal.responses import FrequencyResponses, noise_weights
from hertzloop.studies.modal.universal import RESPONSES, Points
from hertzloop.studies.words import write_records

_NOISE = 1e-3
_JUDGED_HZ = 5e3  # up to here
_FEW = ((4.5, 3.0, (3, 6, 25, 100)), (4.5, 6.0, (3, 6, 25)), (10.0, 3.0, (6, 50)))
_HAMMER = Path(__file__).resolve().parent.parent / "docs" / "examples" / "hammer"
# Scene, kind of response, noise in proportion to each value or to the rms, distance of lines, Hz.
_CASES = (
    ("offcentre-6mm", "accelerance", "value", 0.5),
    ("offcentre-6mm", "receptance", "value", 0.5),
    ("offcentre-6mm", "accelerance", "rms", 0.5),
    ("aluminium-3mm", "accelerance", "value", 0.2),
    ("aluminium-20mm", "mobility", "value", 0.2),
    ("oak-20mm", "accelerance", "value", 0.5),
)


@dataclass(frozen=True)
class Deviation:
    """Largest deviation of modes up to 5 kHz, relative: of frequency, loss factor, shape at the
    contact point and at the actuator; `modes` in the band, and how many were `found`."""

    scene: str
    kind: str
    noise: str
    modes: int
    found: int
    frequency: float
    damping: float
    contact: float
    actuator: float
    seconds: float


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


def deviation(scene: str, kind: str, noise: str, line_hz: float, high_hz: float) -> Deviation:
    """Identify the modes of a scene from noisy responses."""
    known, began = modes_of_scene(load(scene)), time.process_time()
    hz, rng, order = np.arange(5.0, high_hz, line_hz), np.random.default_rng(1), RESPONSES[kind]
    same = np.array_equal(known.shape_contact, known.shape_actuator)
    values = []
    for shape in (known.shape_contact,) if same else (known.shape_contact, known.shape_actuator):
        exact = response(known, hz, shape, order)
        size = np.abs(exact) if noise == "value" else np.sqrt(np.mean(np.abs(exact) ** 2))
        parts = rng.standard_normal((2, len(hz))) / np.sqrt(2.0)
        values.append(exact + _NOISE * size * (parts[0] + 1j * parts[1]))
    points = Points(1) if same else Points(1, 2)
    measured = FrequencyResponses(
        hz, np.array(values), np.array([noise_weights(one) for one in values]), order,
        tuple(range(1, 1 + len(values))), 1, "z",
    )  # fmt: skip
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
    worst = [float(np.max(np.abs(found[nearest] / true - 1.0))) for found, true in pairs]
    return Deviation(
        scene, kind, noise, int(np.count_nonzero(known.omega_rad_s < 2.0 * np.pi * high_hz)),
        len(table.omega_rad_s), worst[0], worst[1], worst[2], worst[3],
        time.process_time() - began,
    )  # fmt: skip


def held_out_hits() -> list[tuple[str, int, float, float]]:
    """Name, number of modes, and errors of each shipped hit, predicted by the two others."""
    records = [read_record(_HAMMER / f"{kind}{i}.csv") for i in (1, 2, 3) for kind in "fa"]
    found = modes_of_hits(hits_of_records(records), [], False, lambda *_: None)
    return [(one.name, one.modes, one.rms, one.peak) for one in found.held_out]


@dataclass(frozen=True)
class FewModes:
    """Error of a first impact with the lowest modes of a plate alone, and what stands for the
    rest: the largest of peak force and plate energy, relative, and rebound speed over impact speed;
    `length` error of the contact time; `expected` by the run."""

    sphere_mm: float
    plate_mm: float
    modes: int
    highest_hz: float
    contact_us: float
    tail: str
    error: float
    length: float
    expected: float


def _first(setup: Setup) -> np.ndarray:
    found = consistent_impacts(setup, simulate(setup).rows)[0]
    scale = setup.sphere.impact_speed_m_s
    energy = 0.5 * setup.sphere.mass_kg * scale**2
    return np.array([found.peak_force_n, found.rebound_speed_m_s / scale,
                     found.plate_energy_j / energy, found.duration_s])  # fmt: skip


def few_modes(sphere_mm: float, plate_mm: float, counts: Sequence[int]) -> Iterator[FewModes]:
    """Impacts on the lowest modes of a plate of 0.3 m by 0.22 m, against all of them."""
    common = ["controller.law=off", f"sphere.radius_m={sphere_mm / 1e3}", "run.duration_s=0.002",
              f"plate.thickness_m={plate_mm / 1e3}", "run.plate_model=modal"]  # fmt: skip
    sizes = ["plate.size_m=[0.3, 0.22]", "plate.contact_point_m=[0.13, 0.09]"]
    whole = load("aluminium-3mm", [*common, *sizes, "plate.loss_factor=0.01"])
    known, true = modes_of_scene(whole), _first(whole)
    with TemporaryDirectory() as folder:
        for count in counts:
            shape = known.shape_contact[:count]
            below = ModeTable(
                known.omega_rad_s[:count], known.loss_factor[:count],
                known.per_modal_mass_1_kg[:count], shape, shape,
            )  # fmt: skip
            file = Path(folder) / f"{count}.csv"
            file.write_bytes(write_modes(".csv", below))
            beyond = known.shape_contact[count:] ** 2 * known.per_modal_mass_1_kg[count:]
            spring = float(np.sum(beyond / known.omega_rad_s[count:] ** 2))
            spring += known.residual_flexibility_m_n or 0.0
            tails = {"infinite plate": ["plate.tail=damped"]}
            for name, value in (("spring", spring), ("nothing", 0.0)):
                tails[name] = ["plate.tail=spring", f"plate.residual_flexibility_m_n={value!r}"]
            for tail, settings in tails.items():
                setup = load("aluminium-3mm", [*common, *settings, f"plate.modes={file}"])
                found = _first(setup)
                error = np.abs(found - true) / np.where([1, 0, 0, 1], true, 1.0)
                hz = float(known.omega_rad_s[count - 1] / (2.0 * np.pi))
                contact_us = 1e6 * rigid_impact(setup.sphere, setup.bodies.contact).contact_s
                yield FewModes(
                    sphere_mm, plate_mm, count, hz, contact_us, tail, float(np.max(error[:3])),
                    float(error[3]), model_error.expected_error(setup),
                )  # fmt: skip


def main(
    out_dir: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Identify modes from noisy frequency responses of shipped scenes, and predict each shipped
    hit of a hammer by the others.

    Example: python -m benchmarks.measured_modes --quick
    """
    check_json(json_file)
    with results_in(out_dir, "measured-modes") as folder:
        cases = _CASES[:1] if quick else _CASES
        high_hz = 2e3 if quick else 6e3
        found = [deviation(*case, high_hz) for case in tracked("responses", cases)]
        names = ("frequency", "damping", "contact", "actuator")
        out.print(
            number_table(
                f"largest deviation of modes up to {_JUDGED_HZ / 1e3:g} kHz, noise {_NOISE:g}",
                ("scene", "responses", "noise by", "modes", "found", *names, "s"),
                [
                    (one.scene, one.kind, one.noise, str(one.modes), str(one.found),
                     *(f"{getattr(one, name):.1e}" for name in names), f"{one.seconds:.0f}")
                    for one in found
                ],
                text=3,
            )
        )  # fmt: skip
        hits = [] if quick else held_out_hits()
        out.print(
            number_table(
                "hits predicted by the other two, first 40 ms",
                ("hit", "modes", "error/rms, %", "largest error/peak, %"),
                [
                    (name, str(modes), f"{100 * rms:.2f}", f"{100 * peak:.2f}")
                    for name, modes, rms, peak in hits
                ],
                text=1,
            )
        )  # fmt: skip
        few = [one for case in (_FEW[:1] if quick else _FEW) for one in few_modes(*case)]
        out.print(
            number_table(
                "first impact on few modes, by what stands for the rest",
                ("R, mm", "plate, mm", "modes", "to Hz", "contact, us", "rest", "error",
                 "of length", "expected"),
                [
                    (f"{one.sphere_mm:g}", f"{one.plate_mm:g}", str(one.modes),
                     f"{one.highest_hz:.0f}", f"{one.contact_us:.0f}", one.tail,
                     *(f"{100 * x:.2g} %" for x in (one.error, one.length, one.expected)))
                    for one in few
                ],
            )
        )  # fmt: skip
        write_records(folder / "responses.csv", found)
        write_records(folder / "few-modes.csv", few)
        figure, [[axes]] = pictures.sheet(1, 1, 6.0, 4.5)
        axes.loglog([one.expected for one in few], [one.error for one in few], "o")
        axes.set(title="Few modes: error of an impact", xlabel="expected", ylabel="found")
        pictures.save(figure, folder / "few-modes.png")
        written(folder, "responses.csv", "few-modes.csv", "few-modes.png")
        data = {
            "responses": [asdict(one) for one in found],
            "few_modes": [asdict(one) for one in few],
        }
        write_json(json_file, data)
        metal = [one for one in found if one.scene != "oak-20mm"]
        conclude(
            f"Frequencies of the metal plates deviate by at most "
            f"{max(one.frequency for one in metal):.1g}, damping by "
            f"{100 * max(one.damping for one in metal):.1g} %, shapes by "
            f"{100 * max(max(one.contact, one.actuator) for one in metal):.1g} %."
        )


if __name__ == "__main__":
    start("benchmarks.measured_modes")
