"""Measured structures: modes from noisy responses of known scenes, from universal files, and from
hits.

No unbiased estimate has smaller standard deviations than the bound of Cramér and Rao. The bound
printed here takes as known how large the noise is and all that lies above the band.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

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
    write_records,
    written,
)
from hertzloop.identification.modes.hits import hits_of_records
from hertzloop.identification.modes.identify import real_rows
from hertzloop.identification.modes.modes import modes_of_hits, modes_of_responses
from hertzloop.identification.modes.responses import FrequencyResponses, noise_weights
from hertzloop.identification.modes.universal import (
    RESPONSES,
    Points,
    modes_of_sets,
    read_sets,
    units_of,
)
from hertzloop.identification.records.reading import read_record
from hertzloop.identification.records.record import Record
from hertzloop.loop.simulate import simulate
from hertzloop.plant.structures.mode_file import ModeTable, write_modes
from hertzloop.results.deflection import modes_of_scene
from hertzloop.scene.setup import load
from hertzloop.studies import pictures

_NOISE = 1e-3
_JUDGED_HZ = 5e3  # up to here
_TARGETS = {"frequency": 1e-5, "damping": 1e-2, "contact": 5e-3, "actuator": 5e-3}
_FILED, _SHORT = "offcentre-6mm", ("run.duration_s=0.004", "run.accuracy=0.01")
_HAMMER = Path(__file__).resolve().parent.parent / "docs" / "examples" / "hammer"
# Scene, kind of response, noise in proportion to each value or to the rms, distance of lines, Hz.
_CASES = (
    ("offcentre-6mm", "accelerance", "value", 0.5),
    ("offcentre-6mm", "receptance", "value", 0.5),
    ("offcentre-6mm", "accelerance", "rms", 0.5),
    ("aluminium-3mm", "accelerance", "value", 0.2),
    ("aluminium-3mm", "accelerance", "value", 0.5),
    ("aluminium-20mm", "mobility", "value", 0.2),
    ("oak-20mm", "accelerance", "value", 0.5),
)


@dataclass(frozen=True)
class Deviation:
    """Largest deviation of modes up to 5 kHz, relative: of frequency, loss factor, shape at the
    contact point and at the actuator, and the bound of their standard deviation in the same mode;
    `modes` in the band, and how many were `found`; how many modes have a bound `beyond` a target.
    """

    scene: str
    kind: str
    noise: str
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
    seconds: float

    @property
    def case(self) -> str:
        """In a table."""
        return f"{self.scene}, {self.kind}, by {self.noise}, {self.line_hz:g} Hz"


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
    known: ModeTable, hz: np.ndarray, shapes: Sequence[np.ndarray], order: int,
    noise: Sequence[np.ndarray],
) -> np.ndarray:  # fmt: skip
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


def deviation(scene: str, kind: str, noise: str, line_hz: float, high_hz: float) -> Deviation:
    """Identify the modes of a scene from noisy responses."""
    known, began = modes_of_scene(load(scene)), time.process_time()
    hz, rng, order = np.arange(5.0, high_hz, line_hz), np.random.default_rng(1), RESPONSES[kind]
    same = np.array_equal(known.shape_contact, known.shape_actuator)
    shapes = (known.shape_contact,) if same else (known.shape_contact, known.shape_actuator)
    values, noises = [], []
    for shape in shapes:
        exact = response(known, hz, shape, order)
        size = np.abs(exact) if noise == "value" else np.sqrt(np.mean(np.abs(exact) ** 2))
        parts = rng.standard_normal((2, len(hz))) / np.sqrt(2.0)
        noises.append(_NOISE * np.broadcast_to(size, hz.shape))
        values.append(exact + noises[-1] * (parts[0] + 1j * parts[1]))
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
    apart = np.array([np.abs(found[nearest] / true - 1.0) for found, true in pairs])
    seconds, worst = time.process_time() - began, np.argmax(apart, axis=1)
    least = bounds(known, hz, shapes, order, noises)[:, : len(nearest)]
    numbers: dict[str, Any] = {}
    for name, mode, found, bound in zip(_TARGETS, worst, apart, least, strict=True):
        numbers |= {name: float(found[mode]), f"{name}_bound": float(bound[mode])}
    return Deviation(
        scene, kind, noise, line_hz,
        modes=int(np.count_nonzero(known.omega_rad_s < 2.0 * np.pi * high_hz)),
        found=len(table.omega_rad_s), seconds=seconds,
        beyond=int(np.count_nonzero(np.any(list(_TARGETS.values()) < least.T, axis=1))), **numbers,
    )  # fmt: skip


@dataclass(frozen=True)
class ByFile:
    """Largest difference of two recordings, over the largest value of each of their signals."""

    modes: str
    difference: float


def by_universal_file() -> Iterator[ByFile]:
    """Recordings with the modes of a scene, written to data set 55 by pyuff and read back, against
    those with modes of six digits and of all digits."""
    import pyuff  # of an extra

    known = modes_of_scene(load(_FILED))
    loss = np.broadcast_to(known.loss_factor, known.omega_rad_s.shape)
    exact = (known.omega_rad_s / (2.0 * np.pi), 1.0 / known.per_modal_mass_1_kg, loss / 2.0,
             known.shape_contact, known.shape_actuator)  # fmt: skip
    flat, names = np.zeros(2), dict.fromkeys((f"id{i}" for i in range(1, 6)), "NONE")
    sets = [
        pyuff.prepare_164(units_code=1, units_description="SI", temp_mode=1, length=1.0, force=1.0,
                          temp=1.0, temp_offset=273.15)
    ]  # fmt: skip
    for i, (hz, mass, ratio, *shape) in enumerate(zip(*exact, strict=True)):
        sets.append(
            pyuff.prepare_55(
                model_type=1, **names, analysis_type=2, data_ch=2, spec_data_type=8, load_case=0,
                mode_n=i + 1, freq=float(hz), modal_m=float(mass), modal_damp_vis=float(ratio),
                modal_damp_his=0.0, node_nums=[1, 2], r1=flat, r2=flat, r3=np.array(shape),
            )
        )  # fmt: skip
    with TemporaryDirectory() as folder:
        file = Path(folder) / "modes.uff"
        pyuff.UFF(str(file)).write_sets(sets, "overwrite")
        read = read_sets(file)
        found = modes_of_sets(read, file, Points(1, 2), units_of(read, file, None)).table

        def rows(
            hz: np.ndarray, mass: np.ndarray, ratio: np.ndarray, shape: np.ndarray,
            there: np.ndarray,
        ) -> np.ndarray:  # fmt: skip
            return recorded(ModeTable(2.0 * np.pi * hz, 2.0 * ratio, 1.0 / mass, shape, there))

        def recorded(table: ModeTable) -> np.ndarray:
            (Path(folder) / "modes.npz").write_bytes(write_modes(".npz", table))
            flexibility = f"plate.residual_flexibility_m_n={known.residual_flexibility_m_n!r}"
            modes = [f"plate.modes={Path(folder) / 'modes.npz'}", flexibility]
            return np.asarray(simulate(load(_FILED, [*modes, *_SHORT])).truth)

        ours, whole = recorded(found), rows(*exact)
        largest = np.maximum(np.abs(whole).max(axis=1, keepdims=True), 1e-300)
        for name, others in (("six digits", rows(*map(_six_digits, exact))), ("all digits", whole)):
            yield ByFile(name, float(np.max(np.abs(ours - others) / largest)))


def _six_digits(values: np.ndarray) -> np.ndarray:
    return np.array([float(f"{value:.5e}") for value in values])


def held_out_hits(
    change: Callable[[Record], Record] = lambda one: one, hits: Sequence[int] = (1, 2, 3)
) -> list[tuple[str, int, float, float]]:
    """Name, number of modes, and errors of each shipped hit, predicted by the others, after a
    change of each record."""
    records = [change(read_record(_HAMMER / f"{kind}{i}.csv")) for i in hits for kind in "fa"]
    found = modes_of_hits(hits_of_records(records), [], False, lambda *_: None)
    return [(one.name, one.modes, one.rms, one.peak) for one in found.held_out]


def _noisy(one: Record) -> Record:
    rng = np.random.default_rng(list(one.name.encode()))
    size = 0.01 * np.max(np.abs(one.value))
    return replace(one, value=one.value + size * rng.standard_normal(len(one.value)))


def _slower(one: Record) -> Record:
    """At half the rate, without what lies above 0.43 of it."""
    both = np.concatenate([one.value, one.value[::-1]])
    hz = np.fft.rfftfreq(len(both), one.interval_s)
    passed = np.fft.rfft(both) / (1.0 + np.exp((hz * 2.0 * one.interval_s - 0.43) * 200.0))
    value = np.fft.irfft(passed, len(both))[: len(one.value)]
    return replace(one, time_s=one.time_s[::2], value=value[::2])


def _part(one: Record, first: int, last: int) -> Record:
    return replace(one, time_s=one.time_s[first:last], value=one.value[first:last])


# Of the last two hits, which begin after 19 samples.
_CHANGES: dict[str, Callable[[Record], Record]] = {
    "none": lambda one: one,
    "noise of 1 % of the peak": _noisy,
    "half the rate": _slower,
    "8 samples before the hit": lambda one: _part(one, 11, len(one.value)),
    "the first 16 ms": lambda one: _part(one, 0, 410),
    "an offset of a tenth of the peak": lambda one: replace(
        one, value=one.value + 0.1 * np.max(np.abs(one.value))
    ),
}


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
        judged = f"modes up to {_JUDGED_HZ / 1e3:g} kHz, noise {_NOISE:g}"
        out.print(
            number_table(
                f"largest deviation of {judged}",
                ("case", "modes", "found", *_TARGETS, "s"),
                [
                    (one.case, str(one.modes), str(one.found),
                     *(f"{getattr(one, name):.1e}" for name in _TARGETS), f"{one.seconds:.0f}")
                    for one in found
                ],
                text=1,
            )
        )  # fmt: skip
        out.print(
            number_table(
                f"bound of the standard deviation in the same mode; {judged}",
                ("case", *_TARGETS, "modes beyond a target"),
                [
                    (one.case, *(f"{getattr(one, f'{name}_bound'):.1e}" for name in _TARGETS),
                     str(one.beyond))
                    for one in found
                ],
                text=1,
            )
        )  # fmt: skip
        filed = list(by_universal_file())
        out.print(
            number_table(
                f"recording of {_FILED} with modes of data set 55, largest difference",
                ("from modes of", "relative"),
                [(one.modes, f"{one.difference:.1e}") for one in filed],
                text=1,
            )
        )
        hits = held_out_hits()
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
        changed = [
            (name, held_out_hits(change, (2, 3)))
            for name, change in tracked(
                "changed hits", list(_CHANGES.items())[: 2 if quick else None]
            )
        ]
        out.print(
            number_table(
                "hits 2 and 3, changed, predicted by each other, first 40 ms",
                ("change", "modes", "error/rms, %"),
                [
                    (name, ", ".join(str(modes) for _, modes, _, _ in some),
                     ", ".join(f"{100 * rms:.1f}" for _, _, rms, _ in some))
                    for name, some in changed
                ],
                text=1,
            )
        )  # fmt: skip
        write_records(folder / "responses.csv", found)
        metric, [[axes]] = pictures.sheet(1, 1, 6.0, 4.5)
        for i, name in enumerate(_TARGETS):
            pairs = [(getattr(one, f"{name}_bound"), getattr(one, name)) for one in found]
            axes.loglog(*zip(*pairs, strict=True), "osd^"[i], label=name)
        axes.axline((1e-6, 1e-6), (1e-3, 1e-3), color="grey")
        axes.set(title="Largest deviation of identified modes", xlabel="bound", ylabel="found")
        axes.legend()
        pictures.save(metric, folder / "responses.png")
        written(folder, "responses.csv", "responses.png")
        data = {
            "responses": [asdict(one) for one in found],
            "universal_file": [asdict(one) for one in filed],
            "hits": [dict(zip(("name", "modes", "error", "largest_error"), one, strict=True))
                     for one in hits],
            "changed_hits": {name: [one[2] for one in some] for name, some in changed},
        }  # fmt: skip
        write_json(json_file, data)
        within = [
            one for one in found
            if all(getattr(one, name) <= target for name, target in _TARGETS.items())
        ]  # fmt: skip
        barred = sum(one.beyond > 0 for one in found if one not in within)
        conclude(
            f"Modes are within all targets in {len(within)} of {len(found)} cases; in {barred} of "
            "the others no unbiased estimate has standard deviations within the targets."
        )


if __name__ == "__main__":
    start("benchmarks.measured_modes")
