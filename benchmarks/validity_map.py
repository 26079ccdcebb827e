"""A map of sphere radius against plate thickness: how much each effect that may be left out costs.

All from Zener's impact on an infinite plate, before any run; each effect as a relative error.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator

from benchmarks.program import (
    OutDirOption,
    QuickOption,
    SceneArgument,
    SetOption,
    conclude,
    number_table,
    out,
    results_in,
    scene_from,
    start,
    written,
)
from hertzloop.plant.contact.hertz import (
    Contact,
    Limit,
    Sphere,
    hertz_stiffness,
    tangent_stiffness_n_m,
)
from hertzloop.plant.contact.yielding import YieldPressure, dent_m, force_n, yielding
from hertzloop.plant.estimates import plate_theory as criteria
from hertzloop.plant.estimates.plate_theory import (
    kirchhoff_error,
    static_difference_m_n,
    thickness_number,
    zener_impact,
    zener_inelasticity,
)
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.plate import Plate
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import Setup, load
from hertzloop.studies import pictures
from hertzloop.studies.words import write_rows

RADII_M = (2e-4, 3e-2)
THICKNESSES_M = (2e-4, 3e-2)
_KH = 120  # of the table from which Kirchhoff's static error is taken
_LAMBDAS = 24  # of the table from which Zener's impact is taken
_TABLED = (1e-3, 30.0)  # lambdas of it
_TAKES_ALL = 1.0  # lambda from which on the plate's energy is right in any theory


@dataclass(frozen=True)
class MapPlace:
    """One place of the map, with its impact: length (s), peak (N), rebound over impact speed."""

    sphere: Sphere
    plate: Plate
    contact: Contact
    strength: YieldPressure | None
    inelasticity: float
    contact_s: float
    peak_n: float


def plate_theory(b: MapPlace) -> float:
    """What Kirchhoff's theory costs: of plate energy, rebound, peak and contact time."""
    number = thickness_number(b.plate, b.contact_s)
    numbers, integral, energy = _kirchhoff_table()
    share = tangent_stiffness_n_m(b.contact.stiffness, b.peak_n)
    beyond = float(np.interp(np.log(number), np.log(numbers), integral))
    peak = abs(beyond) / (b.plate.material.plane_strain_modulus_pa * b.plate.thickness_m) * share
    return max(peak, energy * number * number) if b.inelasticity < _TAKES_ALL else peak


@lru_cache(maxsize=1)
def _kirchhoff_table() -> tuple[np.ndarray, np.ndarray, float]:
    """Numbers k h, the static difference there in units of 1/(E' h), and the plate energy's error
    per (k h)^2: both are the same for every plate."""
    plate = Plate(Material(1.0, 1.0, 0.0), (1.0, 1.0), 1.0)
    numbers = np.geomspace(1e-3, 40.0, _KH)
    found = np.array([static_difference_m_n(plate, float(number)) for number in numbers])
    energy = kirchhoff_error(plate, 1.0, 1.0, 1.0).plate_energy
    return numbers, found, energy / thickness_number(plate, 1.0) ** 2


def yield_loss(b: MapPlace) -> float:
    """Share of the impact's energy that the dent takes, by Thornton's law at the elastic depth."""
    if b.strength is None:
        return float("nan")
    stiffness = b.contact.stiffness
    law = yielding(Limit(b.strength.pressure_pa, b.sphere.radius_m), stiffness)
    depth = np.array((b.peak_n / stiffness) ** (2.0 / 3.0))
    beyond = max(float(depth) - law.delta_m, 0.0)
    if beyond == 0.0:
        return 0.0
    load = float(force_n(law, stiffness, depth, depth))
    taken = law.energy_j + law.force_n * beyond + 0.5 * law.rise_n_m * beyond**2
    lost = taken - 0.4 * load * float(depth - dent_m(law, stiffness, depth))
    return lost / (0.5 * b.sphere.mass_kg * b.sphere.impact_speed_m_s**2)


def large_deflection(b: MapPlace) -> float:
    """Growth of the plate's stiffness, (w/h)^2, with w = 2 m v/Z at most."""
    impulse = b.sphere.mass_kg * b.sphere.impact_speed_m_s
    impulse *= 1.0 + max(1.0 - b.inelasticity, 0.0)
    return (impulse / b.plate.infinite_plate_impedance_n_s_m / b.plate.thickness_m) ** 2


def no_half_space(b: MapPlace) -> float:
    """What Hertz's law misses where the plate is no half space below the contact, (a/h)^2."""
    return (_contact_radius_m(b) / b.plate.thickness_m) ** 2


def sphere_vibration(b: MapPlace) -> float:
    """What the sphere's lowest vibration adds to its compliance, by order of size: the square of
    its period over the length of the contact."""
    return (0.25 / criteria.sphere_periods(b.sphere, b.contact_s)) ** 2


def air(b: MapPlace) -> float:
    """Share of energy that drag on the drop and the squeezed film of air take."""
    return criteria.drag_on_the_drop(b.sphere) + criteria.squeezed_film(b.sphere)


def _contact_radius_m(b: MapPlace) -> float:
    return criteria.contact_radius_m(b.peak_n, b.sphere.radius_m, b.contact.stiffness)


# Effect, what to do about it, and its size.
EFFECTS: tuple[tuple[str, str, Callable[[MapPlace], float]], ...] = (
    ("plate theory", "an elastic solid instead of Kirchhoff's plate", plate_theory),
    ("contact yields", "contact.plasticity = 'thornton'", yield_loss),
    ("large deflection", "the plate is not linear", large_deflection),
    ("thin below the contact", "Hertz's law assumes a half space", no_half_space),
    ("sphere vibrates", "it is not a rigid mass", sphere_vibration),
    ("air", "drag and squeezed film", air),
)


def map_of(setup: Setup, count: int) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Radii, thicknesses (m, each (count,)) and the size of every effect, (thickness, radius).

    Raises SceneError for what is no plate."""
    spec = setup.plant
    if spec.plate.local_plate is None:
        raise SceneError("a map over thickness needs a plate. Remove plate.modes.")
    radii, thicknesses = (np.geomspace(*ends, count) for ends in (RADII_M, THICKNESSES_M))
    found = setup.mechanics.weaker
    strength = None if found is None else found[1]
    lasts = _zener_table(spec.sphere, spec.plate.local_plate)
    sizes = {name: np.zeros((count, count)) for name, _, _ in EFFECTS}
    for i, h in enumerate(thicknesses):
        for j, r in enumerate(radii):
            bodies = _bodies(spec.sphere, spec.plate.local_plate, r, h, strength, lasts)
            for name, _, size in EFFECTS:
                sizes[name][i, j] = size(bodies)
    return radii, thicknesses, sizes


def _at(sphere: Sphere, plate: Plate, radius_m: float, thickness_m: float) -> tuple[
    Sphere, Plate, Contact
]:  # fmt: skip
    ball, sheet = replace(sphere, radius_m=radius_m), replace(plate, thickness_m=thickness_m)
    return ball, sheet, Contact(hertz_stiffness(radius_m, ball.material, sheet.material))


def _unit_s(sphere: Sphere, contact: Contact) -> float:
    return float((sphere.mass_kg / (contact.stiffness * sphere.impact_speed_m_s**0.5)) ** 0.4)


def _zener_table(sphere: Sphere, plate: Plate) -> np.ndarray:
    """Zener's impact by its one number: lambda, length in units of t*, peak in units of m v/t*;
    shape (3, _LAMBDAS)."""
    rows = []
    first = zener_inelasticity(*_at(sphere, plate, RADII_M[0], 1e-3))
    for number in np.geomspace(*_TABLED, _LAMBDAS):
        # lambda is as h^-2 for one sphere.
        bodies = _at(sphere, plate, RADII_M[0], 1e-3 * float(first / number) ** 0.5)
        impact, unit_s = zener_impact(*bodies), _unit_s(bodies[0], bodies[2])
        force_n = bodies[0].mass_kg * bodies[0].impact_speed_m_s / unit_s
        rows.append((number, impact.contact_s / unit_s, impact.peak_force_n / force_n))
    return np.array(rows).T


def _from_table(table: np.ndarray, number: float, column: int) -> float:
    """A column at a lambda: that of a rigid plate below the table, a power law beyond it."""
    known, values = np.log(table[0]), np.log(table[column])
    at = float(np.log(number))
    found = float(np.interp(at, known, values))
    slope = (values[-1] - values[-2]) / (known[-1] - known[-2])
    return float(np.exp(found + slope * max(at - known[-1], 0.0)))


def _bodies(
    sphere: Sphere, plate: Plate, radius_m: float, thickness_m: float,
    strength: YieldPressure | None, table: np.ndarray,
) -> MapPlace:  # fmt: skip
    ball, sheet, contact = _at(sphere, plate, float(radius_m), float(thickness_m))
    number, unit_s = zener_inelasticity(ball, sheet, contact), _unit_s(ball, contact)
    lasts, peak = (_from_table(table, number, column) for column in (1, 2))
    force = peak * ball.mass_kg * ball.impact_speed_m_s / unit_s
    return MapPlace(ball, sheet, contact, strength, number, lasts * unit_s, force)


def run(setup: Setup, folder: Path, count: int = 61) -> dict[str, np.ndarray]:
    """Write the map as picture and CSV; the sizes."""
    radii, thicknesses, sizes = map_of(setup, count)
    names = [name for name, _, _ in EFFECTS]
    write_rows(
        folder / "validity.csv", ["radius_m", "thickness_m", *names],
        ([r, h, *(sizes[name][i, j] for name in names)]
         for i, h in enumerate(thicknesses) for j, r in enumerate(radii)),
    )  # fmt: skip
    ball, sheet = setup.sphere.material, setup.structure.material
    about = (
        f"{setup.striker_material or 'own'} on {setup.plate_material or 'own'} "
        f"({sheet.youngs_modulus_pa * 1e-9:.3g} GPa), dropped from "
        f"{1e3 * setup.sphere.drop_height_m:.3g} mm; {ball.density_kg_m3:z.0f} kg/m3"
    )
    draw_map(folder / "validity.png", about, radii, thicknesses, sizes,
             {name: words for name, words, _ in EFFECTS})  # fmt: skip
    return sizes


_LEVELS = ((1e-3, "effects above 0.1 %"), (1e-1, "effects above 10 %"))
_SCENES = ("aluminium-3mm", "offcentre-6mm", "aluminium-20mm")
_LATE_MM = 10.0  # radius from which on a name ends at its star
_TICKS = (0.2, 0.5, 1, 2, 5, 10, 20)
_HATCHES = ("", "////", "....", "xxx", "", "")
_PLACES = (0.6, 0.5, 0.25, 0.6, 0.5, 0.9)  # of the length of a line, where its name is
_PLAIN = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1}


def draw_map(
    path: Path, about: str, radii_m: np.ndarray, thicknesses_m: np.ndarray,
    sizes: dict[str, np.ndarray], remedies: dict[str, str],
) -> None:  # fmt: skip
    """Two panels, a limit each: every effect has a line, and a shade where it matters."""
    sheet, axes = pictures.sheet(1, 2, width=13.0, height=7.0)
    x, y = 1e3 * radii_m, 1e3 * thicknesses_m
    known = {name: size for name, size in sizes.items() if not np.isnan(size).any()}
    places = {name: i for i, name in enumerate(sizes)}
    for ax, (level, title) in zip(axes[0], _LEVELS, strict=True):
        everywhere = [name for name, size in known.items() if size.min() > level]
        for name, size in known.items():
            if size.min() <= level < size.max():
                _shade(ax, x, y, size, level, name, places[name])
        if everywhere:
            title += f"; everywhere: {', '.join(everywhere)}"
        _mark_scenes(ax)
        ax.set(xscale="log", yscale="log", xlabel="radius of the sphere (mm)", title=title)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(FixedLocator(_TICKS))
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_locator(FixedLocator(()))
        ax.set_xlim(x[0], x[-1])
        ax.set_ylim(y[0], y[-1])
    axes[0, 0].set_ylabel("thickness of the plate (mm)")
    handles = [
        _key(name, remedies[name], places[name])
        for name, size in known.items()
        if size.max() > _LEVELS[0][0]
    ]
    sheet.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=9,
                 title="shaded: effect, and what models it or what it means")  # fmt: skip
    sheet.suptitle(f"Neglected effects: {about}\nunshaded: Kirchhoff's plate and Hertz's elastic "
                   "contact suffice; sizes from Zener's impact")  # fmt: skip
    pictures.save(sheet, path)


def _mark_scenes(ax: Any) -> None:
    """Shipped scenes of these materials, by their names."""
    for name in _SCENES:
        setup = load(name)
        plate = setup.structure.local_plate
        assert plate is not None  # each is a plate
        radius, thickness = 1e3 * setup.sphere.radius_m, 1e3 * plate.thickness_m
        ax.plot(radius, thickness, "k*", markersize=11, zorder=7)
        side = "right" if radius > _LATE_MM else "center"
        ax.annotate(name, (radius, thickness), xytext=(0, 9), textcoords="offset points", ha=side,
                    weight="bold", zorder=7, bbox=_PLAIN)  # fmt: skip


def _shade(
    ax: Any, x: np.ndarray, y: np.ndarray, size: np.ndarray, level: float, name: str, index: int
) -> None:
    """One effect: shade above the level, its line, and its name on that."""
    look = pictures.look(index)
    ax.contourf(x, y, size, [level, np.inf], colors=[look["color"]], alpha=0.16,
                hatches=[_HATCHES[index]])  # fmt: skip
    lines = ax.contour(x, y, size, [level], colors=[look["color"]], linewidths=2.0)
    lines.set_linestyle(look["linestyle"])
    for line in lines.allsegs[0]:
        # Each effect at a place of its own along its line, so that names do not meet.
        where = line[np.argsort(line[:, 1])][int(len(line) * _PLACES[index])]
        side = "right" if where[0] > _LATE_MM else "center"
        ax.text(*where, name, color=look["color"], weight="bold", ha=side, va="center",
                zorder=6, bbox=_PLAIN)  # fmt: skip


def _key(name: str, remedy: str, index: int) -> Patch:
    colour = pictures.look(index)["color"]
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return Patch(facecolor=(red, green, blue, 0.16), edgecolor=colour, hatch=_HATCHES[index],
                 linewidth=1.5, label=f"{name}: {remedy}")  # fmt: skip


def main(
    scene: SceneArgument = DEFAULT,
    settings: SetOption = None,
    folder: OutDirOption = None,
    quick: QuickOption = False,
) -> None:
    """Map the effects that a scene's materials neglect, over radius and thickness.

    With --quick: nine values of each.

    Example: python -m benchmarks.validity_map aluminium-3mm --out-dir map
    """
    resolved = scene_from(scene, settings, None)
    with results_in(folder, "validity_map") as made:
        sizes = run(resolved, made, 9 if quick else 61)
    rows = [
        (name, *(f"{100.0 * (size > level).mean():.0f} %" for level, _ in _LEVELS))
        for name, size in sizes.items()
    ]
    out.print(number_table("Share of the map", ("effect", "above 0.1 %", "above 10 %"), rows, 1))
    written(made, "validity.csv", "validity.png")
    worst = max(sizes, key=lambda name: float((sizes[name] > _LEVELS[0][0]).mean()))
    conclude(f"The effect above 0.1 % in most of the map is: {worst}.")


if __name__ == "__main__":
    start("benchmarks.validity_map")
