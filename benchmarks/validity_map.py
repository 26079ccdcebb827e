"""A map of sphere radius against plate thickness: how much each effect that may be left out costs.

All from Zener's impact on an infinite plate, before any run; each effect as a relative error.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator

from benchmarks.program import OutDirOption, QuickOption, start
from benchmarks.results import Results, results_in
from benchmarks.scenes import load
from benchmarks.zener import zener_impact
from hertzloop.cli.options import SceneArgument, SetOption
from hertzloop.cli.prepare import scene_from
from hertzloop.plant.contact.hertz import Contact, Limit, Sphere, hertz_stiffness
from hertzloop.plant.contact.yielding import YieldPressure, dent_m, force_n, yielding
from hertzloop.plant.estimates import criteria
from hertzloop.plant.structures.plate import Plate
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.materials import material_name
from hertzloop.scene.setup import Setup
from hertzloop.studies.pages import pictures

RADII_M = (2e-4, 3e-2)
THICKNESSES_M = (2e-4, 3e-2)
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
    """What Kirchhoff's theory costs: of the peak force, and of the plate energy where the plate
    does not take all of it."""
    error = criteria.thin_plate_error(b.plate, b.contact.stiffness, b.contact_s, b.peak_n)
    return max(error.peak_force, error.plate_energy if b.inelasticity < _TAKES_ALL else 0.0)


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


Sizes = dict[str, np.ndarray]  # of each effect, (thickness, radius)
# Effect, what to do about it, and its size.
EFFECTS: tuple[tuple[str, str, Callable[[MapPlace], float]], ...] = (
    ("plate theory", "Kirchhoff's plate has no thickness", plate_theory),
    ("contact yields", "contact.plasticity = 'thornton'", yield_loss),
    ("large deflection", "the plate is not linear", large_deflection),
    ("thin below the contact", "Hertz's law assumes a half space", no_half_space),
    ("sphere vibrates", "it is not a rigid mass", sphere_vibration),
    ("air", "drag and squeezed film", air),
)


def map_of(setup: Setup, count: int) -> tuple[np.ndarray, np.ndarray, Sizes]:
    """Radii, thicknesses (m, each (count,)) and the size of every effect, (thickness, radius).

    Raises SceneError for what is no plate."""
    spec = setup.plant
    if spec.plate.local_plate is None:
        raise SceneError("a map over thickness needs a plate. Remove plate.modes.")
    radii, thicknesses = (np.geomspace(*ends, count) for ends in (RADII_M, THICKNESSES_M))
    found = setup.mechanics.weaker
    strength = None if found is None else found[1]
    sizes = {name: np.zeros((count, count)) for name, _, _ in EFFECTS}
    for i, h in enumerate(thicknesses):
        for j, r in enumerate(radii):
            bodies = place(spec.sphere, spec.plate.local_plate, float(r), float(h), strength)
            for name, _, size in EFFECTS:
                sizes[name][i, j] = size(bodies)
    return radii, thicknesses, sizes


def place(
    sphere: Sphere,
    plate: Plate,
    radius_m: float,
    thickness_m: float,
    strength: YieldPressure | None,
) -> MapPlace:
    """The same sphere and plate with another radius and thickness."""
    ball, sheet = replace(sphere, radius_m=radius_m), replace(plate, thickness_m=thickness_m)
    contact = Contact(hertz_stiffness(radius_m, ball.material, sheet.material))
    impact = zener_impact(ball, sheet, contact)
    return MapPlace(
        ball,
        sheet,
        contact,
        strength,
        impact.inelasticity,
        impact.contact_s,
        impact.peak_force_n,
    )


def run(setup: Setup, results: Results, count: int = 61) -> Sizes:
    """Write the map as picture and CSV; the sizes."""
    radii, thicknesses, sizes = map_of(setup, count)
    names = [name for name, _, _ in EFFECTS]
    results.write_rows(
        "validity",
        ["radius_m", "thickness_m", *names],
        (
            [r, h, *(sizes[name][i, j] for name in names)]
            for i, h in enumerate(thicknesses)
            for j, r in enumerate(radii)
        ),
    )
    ball, sheet = setup.mechanics.sphere.material, setup.mechanics.structure.material
    bodies = " on ".join(
        material_name(table.material) or "own" for table in (setup.scene.sphere, setup.scene.plate)
    )
    about = (
        f"{bodies} "
        f"({sheet.youngs_modulus_pa * 1e-9:.3g} GPa), dropped from "
        f"{1e3 * setup.mechanics.sphere.drop_height_m:.3g} mm; {ball.density_kg_m3:z.0f} kg/m3"
    )
    draw_map(results.path("validity.png"), about, radii, thicknesses, sizes)
    return sizes


_LEVELS = ((1e-3, "effects above 0.1 %"), (1e-1, "effects above 10 %"))
_SCENES = ("aluminium-3mm", "offcentre-6mm", "aluminium-20mm")
_LATE_MM = 10.0  # radius from which on a name ends at its star
_TICKS = (0.2, 0.5, 1, 2, 5, 10, 20)
_PLAIN = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1}


def draw_map(
    path: Path, about: str, radii_m: np.ndarray, thicknesses_m: np.ndarray, sizes: Sizes
) -> None:
    """Two panels, a limit each: every effect has a line, and a shade where it matters."""
    sheet, axes = pictures.sheet(1, 2, width=13.0, height=7.0)
    x, y = 1e3 * radii_m, 1e3 * thicknesses_m
    for ax, (level, title) in zip(axes[0], _LEVELS, strict=True):
        everywhere = [name for name, size in sizes.items() if size.min() > level]
        for i, size in enumerate(sizes.values()):
            if size.min() <= level < size.max():  # nan where an effect is not known
                look = pictures.look(i)
                ax.contourf(x, y, size, [level, np.inf], colors=[look["color"]], alpha=0.16)
                lines = ax.contour(x, y, size, [level], colors=[look["color"]], linewidths=2.0)
                lines.set_linestyle(look["linestyle"])
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
        Line2D([], [], label=f"{name}: {remedy}", linewidth=2.0, **pictures.look(i))
        for i, (name, remedy, _) in enumerate(EFFECTS)
        if sizes[name].max() > _LEVELS[0][0]
    ]
    sheet.legend(
        handles=handles,
        loc="outside lower center",
        ncols=2,
        fontsize=9,
        title="shaded: effect, and what models it or what it means",
    )
    sheet.suptitle(
        f"Neglected effects: {about}\nunshaded: Kirchhoff's plate and Hertz's elastic "
        "contact suffice; sizes from Zener's impact"
    )
    pictures.save(sheet, path)


def _mark_scenes(ax: Any) -> None:
    """Shipped scenes of these materials, by their names."""
    for name in _SCENES:
        setup = load(name)
        plate = setup.mechanics.structure.local_plate
        assert plate is not None  # each is a plate
        radius, thickness = 1e3 * setup.mechanics.sphere.radius_m, 1e3 * plate.thickness_m
        ax.plot(radius, thickness, "k*", markersize=11, zorder=7)
        side = "right" if radius > _LATE_MM else "center"
        ax.annotate(
            name,
            (radius, thickness),
            xytext=(0, 9),
            textcoords="offset points",
            ha=side,
            weight="bold",
            zorder=7,
            bbox=_PLAIN,
        )


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
    with results_in(folder, "validity_map") as results:
        sizes = run(resolved, results, 9 if quick else 61)
        shares = {
            name: [100.0 * float((size > level).mean()) for level, _ in _LEVELS]
            for name, size in sizes.items()
        }
        results.table(
            "Share of the map",
            {
                "effect": "{[0]}",
                "above 0.1 %": "{[1][0]:.0f} %",
                "above 10 %": "{[1][1]:.0f} %",
            },
            shares.items(),
        )
        worst = max(shares, key=lambda name: shares[name][0])
        results.conclude(f"The effect above 0.1 % in most of the map is: {worst}.")


if __name__ == "__main__":
    start("benchmarks.validity_map")
