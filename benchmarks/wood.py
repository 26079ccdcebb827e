"""Measured frequencies of spruce plates against an orthotropic plate whose constants fit them.

Two plates of other laboratories: one clamped along an edge, one free. Young's moduli along and
across the grain and the shear modulus are fitted to all frequencies of a plate; Poisson's ratio,
which moves no frequency by a percent, is that of the table of materials. The isotropic plate is
fitted too, by its Young's modulus alone.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from benchmarks.program import OutDirOption, QuickOption, start
from benchmarks.results import results_in
from hertzloop.cli.terminal import out
from hertzloop.plant.structures.edged_plate import EdgedPlate
from hertzloop.plant.structures.materials import MATERIALS, Material, material_of
from hertzloop.plant.structures.plate import Plate

_KEYS = ("young_x_pa", "young_y_pa", "shear_pa")
_MODELS = ("fitted", "table", "isotropic")
_STILL_HZ = 1.0  # a free plate's rigid modes are below


@dataclass(frozen=True)
class Measured:
    """A plate that was measured: grain along x, edges as of a scene, lowest frequencies in Hz."""

    name: str
    edges: str
    size_m: tuple[float, float]
    thickness_m: float
    density_kg_m3: float
    frequencies_hz: tuple[float, ...]


PLATES = (
    Measured(
        "cantilever",
        "cfff",
        (0.212, 0.108),
        0.0045,
        457.0,
        (87.0, 160.0, 540.0, 616.0, 651.0, 1061.0),
    ),
    Measured(
        "free",
        "ffff",
        (0.5798, 0.2134),
        0.0048,
        0.236 / (0.5798 * 0.2134 * 0.0048),
        (47.0, 70.5, 121.0, 200.0, 243.5),
    ),
)


@dataclass(frozen=True)
class Deviation:
    """One frequency: measured, and by how much a model is off, in percent."""

    plate: str
    model: str
    mode: int
    measured_hz: float
    modelled_hz: float
    percent: float


def spruce(density_kg_m3: float, constants: np.ndarray) -> Material:
    """Spruce with other moduli (Pa), as of `_KEYS`."""
    moduli = dict(zip(_KEYS, map(float, constants), strict=True))
    poisson = MATERIALS["spruce"].poisson_xy
    return material_of("spruce", {**moduli, "poisson_xy": poisson, "density_kg_m3": density_kg_m3})


def lowest_hz(of: Measured, material: Material) -> np.ndarray:
    """As many of the lowest frequencies as were measured, Hz."""
    plate = EdgedPlate(Plate(material, of.size_m, of.thickness_m), of.edges, 1e-2)
    point = (0.4 * of.size_m[0], 0.4 * of.size_m[1])
    limit = 2.0 * np.pi * 5.0 * of.frequencies_hz[-1]
    found = plate.modes(limit, point, point).omega / (2.0 * np.pi)
    return np.asarray(found[found > _STILL_HZ][: len(of.frequencies_hz)])


def fitted(of: Measured) -> tuple[Material, Material]:
    """The orthotropic and the isotropic material that fit a plate best."""
    known = np.log(of.frequencies_hz)

    def off(logs: np.ndarray) -> np.ndarray:
        return np.asarray(np.log(lowest_hz(of, spruce(of.density_kg_m3, np.exp(logs)))) - known)

    table = MATERIALS["spruce"]
    begin = np.log([getattr(table, key) for key in _KEYS])
    best = scipy.optimize.least_squares(off, begin, diff_step=[1e-3]).x
    plain = Material(1e10, of.density_kg_m3, 0.3)
    # All frequencies go with the root of Young's modulus.
    shift = float(np.mean(known - np.log(lowest_hz(of, plain))))
    return (
        spruce(of.density_kg_m3, np.exp(best)),
        replace(plain, youngs_modulus_pa=1e10 * np.exp(2.0 * shift)),
    )


def deviations(of: Measured, model: str, material: Material) -> list[Deviation]:
    """Every frequency of a plate by a material."""
    return [
        Deviation(of.name, model, i, hz, float(ours), 100.0 * (float(ours) / hz - 1.0))
        for i, (hz, ours) in enumerate(
            zip(of.frequencies_hz, lowest_hz(of, material), strict=True), 1
        )
    ]


def main(out_dir: OutDirOption = None, quick: QuickOption = False) -> None:
    """Fit orthotropic plates to measured frequencies of spruce, and print every deviation.

    Example: python -m benchmarks.wood --quick
    """
    table = MATERIALS["spruce"]
    found: list[Deviation] = []
    with results_in(out_dir, "wood") as results:
        for plate in PLATES[:1] if quick else PLATES:
            wood, plain = fitted(plate)
            constants = ", ".join(f"{key} {getattr(wood, key) * 1e-9:.3g}" for key in _KEYS)
            out.print(f"{plate.name}: {constants}; isotropic {plain.youngs_modulus_pa * 1e-9:.3g}")
            shipped = spruce(plate.density_kg_m3, np.array([getattr(table, k) for k in _KEYS]))
            for model, material in zip(_MODELS, (wood, shipped, plain), strict=True):
                found += deviations(plate, model, material)
        results.write("wood", found)
        by_model = [[d for d in found if d.model == name] for name in _MODELS]
        results.table(
            "Deviation from the measured frequency, percent; moduli in GPa above",
            {"plate": "{[0].plate}", "mode": "{[0].mode}", "measured Hz": "{[0].measured_hz:g}"}
            | {name: f"{{[{i}].percent:+.1f}}" for i, name in enumerate(_MODELS)},
            zip(*by_model, strict=True),
        )
        ours, _, other = (max(abs(d.percent) for d in some) for some in by_model)
        results.conclude(
            f"An orthotropic plate with three fitted moduli is off by {ours:.1f} % at most, an "
            f"isotropic one by {other:.1f} %."
        )


if __name__ == "__main__":
    start("benchmarks.wood")
