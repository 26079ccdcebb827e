"""Records of a drop whose truth is known, and their fits."""

from pathlib import Path

import numpy as np

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.free_keys import parse_free_key
from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup, load

YIELDS = ("contact.plasticity=thornton", "contact.limiting_pressure_pa=8e8")
PRESSURE, HEIGHT = "contact.limiting_pressure_pa", "sphere.drop_height_m"
RADIUS, THICKNESS = "sphere.radius_m", "plate.thickness_m"


def scene(*changes: str) -> Setup:
    return load("aluminium-3mm", ["controller.law=off", *changes])


def record(
    setup: Setup,
    quantity: str = "contact_force",
    duration_s: float = 80e-6,
    seed: int = 3,
    **spoilt: float,
) -> Record:
    return measured(truth(setup, quantity, duration_s, accuracy=1e-4), Spoilt(**spoilt), seed)


def fitted(setup: Setup, one: Record | list[Record], *keys: str) -> FitResult:
    records = one if isinstance(one, list) else [one]
    return fit(setup, records, [parse_free_key(setup, key) for key in keys])


def assert_holds(found: FitResult, *true: float) -> None:
    """Every interval holds its true value."""
    for estimate, value in zip(found.estimates, true, strict=True):
        assert estimate.low < value < estimate.high, estimate.key


def write_csv(path: Path, one: Record, name: str = "contact_force_n") -> str:
    """Write a record, and return its path."""
    path.parent.mkdir(exist_ok=True)
    np.savetxt(
        path,
        np.stack([one.time_s, one.value], 1),
        delimiter=",",
        header=f"time_s,{name}",
        comments="",
        fmt="%.12g",
    )
    return str(path)
