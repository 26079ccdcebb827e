"""Measured hits of a hammer, fitted one by one and together, with the last one held out."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import scipy

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption
from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.keys.free_key_option import parse_free_key
from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.modes.from_hits import modes_of_hits
from hertzloop.fitting.modes.hit_responses import hits_of_records
from hertzloop.fitting.records.reading import read_record
from hertzloop.fitting.records.record import Record
from hertzloop.plant.structures.mode_file import ModeTable, write_modes
from hertzloop.scene.setup import Setup, load

_HAMMER = Path(__file__).resolve().parent.parent / "docs" / "examples" / "hammer"
_CONVERTER = {"low_pass": "sigma-delta", "low_pass_hz": 11_520.0}  # 0.45 of the rate
_STIFFNESS = "hammer.tip_stiffness"
_KEYS = (_STIFFNESS, "contact.restitution=0.3:0.99")
_SCENE = (
    "controller.law=off",
    "hammer.mass_kg=0.1",
    "hammer.speed_m_s=0.1",
    "hammer.tip_stiffness=3e9",
    "hammer.tip_exponent=1.5",
    "contact.damping=hunt_crossley",
    "contact.restitution=0.7",
)
# How far the point that is hit gives way, over the sensor's point: no record tells it.
_SHARES = (0.5, 1.0, 0.001)
# A mode of the point that is hit alone: where its search begins, and the first steps.
_OWN_HZ, _OWN_KG, _OWN_LOSS = 3500.0, 0.2, 0.04
_FIRST_STEPS, _MOST_FITS = (0.1, 0.2, 0.4), 25
_OWN_SHARES, _KNOWN_GAIN = (0.5, 0.001), 1e-3


class OwnMode(NamedTuple):
    """A mode in which the accelerometer's point rests: frequency, Hz, modal mass, kg, where the
    point that is hit moves by one, and loss factor."""

    hz: float
    kg: float
    loss: float


@dataclass(frozen=True)
class Fitted:
    """A fit of hits: frequency of the mode of the point that is hit (zero without it), stiffness of
    the tip (N/m^1.5), restitution, farthest clock from zero over its prior, and the errors of the
    hit that is held out over its peak, in the pulse (root mean square) and largest, %; zeros
    without one."""

    share: float
    records: str
    own_hz: float
    stiffness: float
    restitution: float
    clock_sd: float
    in_pulse_percent: float
    largest_percent: float


def record(kind: str, hit: int) -> Record:
    """A shipped record: force "f" or acceleration "a" of a hit."""
    return read_record(_HAMMER / f"{kind}{hit}.csv", _CONVERTER)


def modes() -> ModeTable:
    """Modes of hits 1 and 2 alone, from the point that is hit to the accelerometer."""
    records = [record(kind, hit) for hit in (1, 2, 3) for kind in "fa"]
    hits = hits_of_records(records)
    return modes_of_hits(hits[:2], hits[2:], False, lambda *_: None).table


def rig(table: ModeTable, share: float, folder: Path, own: OwnMode | None = None) -> Setup:
    """The scene whose contact point moves by a share of what the sensor's point does, and in a mode
    of its own; what the sensor shows of a force is always as measured."""
    assert table.shape_sensor is not None
    scaled = replace(
        table,
        shape_contact=share * table.shape_contact,
        shape_sensor=table.shape_sensor / share,
        shape_actuator=share * table.shape_actuator,
    )
    if own is not None:
        added: dict[str, Any] = {
            "omega_rad_s": 2.0 * math.pi * own.hz,
            "loss_factor": own.loss,
            "per_modal_mass_1_kg": 1.0 / own.kg,
            "shape_contact": 1.0,
            "shape_actuator": 1.0,
            "shape_sensor": 0.0,
        }
        at = int(np.searchsorted(scaled.omega_rad_s, added["omega_rad_s"]))
        added = {key: np.insert(getattr(scaled, key), at, one) for key, one in added.items()}
        scaled = replace(scaled, **added)
    path = folder / f"modes-{share:g}.csv"
    path.write_bytes(write_modes(".csv", scaled))
    plate = {
        "plate.modes": str(path),
        "plate.tail": "spring",
        "plate.thickness_m": None,
        "plate.residual_flexibility_m_n": 1e-12,
        "plate.size_m": None,
    }
    return load("aluminium-20mm", _SCENE).vary(plate)


def own_mode(table: ModeTable, share: float, folder: Path) -> OwnMode:
    """The mode of the point that is hit with which the forces of hits 1 and 2 fit best."""
    forces = [record("f", hit) for hit in (1, 2)]
    begin = np.log([_OWN_HZ, _OWN_KG, _OWN_LOSS])

    def misfit(logarithms: np.ndarray) -> float:
        setup = rig(table, share, folder, OwnMode(*np.exp(logarithms)))
        free = [parse_free_key(setup, key) for key in _KEYS]
        return fit(setup, forces, free, hold_out=[], exact=True).residual_over_noise

    found = scipy.optimize.minimize(
        misfit,
        begin,
        method="Nelder-Mead",
        options={
            "initial_simplex": begin + np.vstack([np.zeros(3), np.diag(_FIRST_STEPS)]),
            "maxfev": _MOST_FITS,
            "xatol": 0.01,
            "fatol": 0.05,
        },
    )
    return OwnMode(*(float(value) for value in np.exp(found.x)))


def judged(share: float, what: str, found: FitResult, own: OwnMode | None) -> Fitted:
    """The numbers of a fit."""
    values = {e.key: e.value for e in found.estimates}
    held = found.hold_out or {"in_pulse_percent": [0.0], "largest_percent": [0.0]}
    return Fitted(
        share,
        what,
        own.hz if own else 0.0,
        values[_STIFFNESS],
        values["contact.restitution"],
        max(abs(n.clock_ppm) for n in found.nuisances) / 50.0,
        max(held["in_pulse_percent"]),
        max(held["largest_percent"]),
    )


def fitted(quick: bool, folder: Path) -> Iterator[Fitted]:
    """Fits of single hits and of the forces of all."""
    table = modes()
    forces = [record("f", hit) for hit in (1, 2, 3)]
    for share in _SHARES[:1] if quick else _SHARES:
        setup = rig(table, share, folder)
        yield from _of_forces(setup, share, forces, None)
    known = [
        replace(one, measurement=replace(one.measurement, sensitivity_uncertainty=_KNOWN_GAIN))
        for one in forces
    ]
    for share in () if quick else _OWN_SHARES:
        own = own_mode(table, share, folder)
        setup = rig(table, share, folder, own)
        yield from _of_forces(setup, share, known, own)


def _of_forces(
    setup: Setup, share: float, forces: list[Record], own: OwnMode | None
) -> Iterator[Fitted]:
    """Fits of every force alone and of all. With a mode of its own, least squares: the error of
    the model has been put into this mode."""
    free = [parse_free_key(setup, key) for key in _KEYS]
    alone, exact = [*free, parse_free_key(setup, "hammer.speed_m_s")], own is not None
    for hit, one in enumerate(forces, 1):
        found = fit(setup, [one], alone, exact=exact)
        yield judged(share, f"force of hit {hit}", found, own)
    found = fit(setup, forces, free, exact=exact)
    yield judged(share, "forces, hit 3 held out", found, own)


def _or_empty(field: str, digits: str) -> Callable[[Fitted], str]:
    """A number of a fit as text, empty where it is zero."""
    return lambda one: f"{getattr(one, field):{digits}}" if getattr(one, field) else ""


def main(
    folder: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Fit three measured hits of a hammer (docs/examples/hammer) one by one and together.

    The modes are those of hits 1 and 2. How far the point that is hit gives way was not measured,
    so that it is varied. Then this point gets one more mode, which is found from the forces of hits
    1 and 2 alone. With --quick there is one value and no such mode.

    Example: python -m benchmarks.fit_hits --quick
    """
    with (
        results_in(folder, "fit_hits", "modal", json_file=json_file) as results,
        TemporaryDirectory() as files,
    ):
        found = list(tracked("fits", fitted(quick, Path(files))))
        results.write("fit_hits", found)
        results.table(
            "hits of a hammer",
            {
                "records": "{.records}",
                "share": "{.share:g}",
                "own mode, Hz": _or_empty("own_hz", ".4g"),
                "stiffness, N/m^1.5": "{.stiffness:.3g}",
                "restitution": "{.restitution:.3f}",
                "clock, sd": "{.clock_sd:.2f}",
                "held out: in the pulse, %": _or_empty("in_pulse_percent", ".2g"),
                "largest, %": _or_empty("largest_percent", ".2g"),
            },
            found,
        )
        last = [one for one in found if bool(one.own_hz) is not quick and one.share == _SHARES[0]]
        single = [one.stiffness for one in last[:3]]
        apart = 50.0 * (max(single) - min(single)) / (sum(single) / 3.0)
        results.conclude(
            f"The stiffness of the tip is the same within {apart:.2g} % (+/-) over the hits, and "
            f"the held-out hit is off by {last[3].in_pulse_percent:.2g} % of its peak in the "
            f"pulse, at most by {last[3].largest_percent:.2g} %."
        )


if __name__ == "__main__":
    start("benchmarks.fit_hits")
