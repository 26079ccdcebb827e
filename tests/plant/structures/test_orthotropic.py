"""Orthotropic plates against closed forms, finite elements and isotropic plates."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from hertzloop.plant.structures.edged_plate import EdgedPlate
from hertzloop.plant.structures.materials import MATERIALS, SHIPPED, Material, material_of
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.structure import Structure
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from tests.tiers import default

SPRUCE, SIZE, THICKNESS = MATERIALS["spruce"], (0.58, 0.21), 0.0048
POINT, OTHER = (0.17, 0.08), (0.31, 0.15)
# Isotropic, said as an orthotropic material.
TURNED = material_of(
    "metal",
    {
        "young_x_pa": 7.2e10,
        "young_y_pa": 7.2e10,
        "shear_pa": 7.2e10 / 2.68,
        "poisson_xy": 0.34,
        "density_kg_m3": 2700.0,
    },
)
METAL = Material(7.2e10, 2700.0, 0.34)


def rigidities(of: Material, h: float) -> tuple[float, float, float, float]:
    """D_x, D_y, D_1 and D_xy as a textbook has them, N m."""
    x, y, shear, nu = of.young_x_pa, of.young_y_pa, of.shear_pa, of.poisson_xy
    by_yx = nu * y / x
    whole = h**3 / 12.0 / (1.0 - nu * by_yx)
    return x * whole, y * whole, nu * y * whole, shear * h**3 / 12.0


def edged(material: Material, edges: str, size_m: tuple[float, float] = SIZE) -> EdgedPlate:
    return EdgedPlate(Plate(material, size_m, THICKNESS), edges, 1e-3)


def test_simply_supported_modes_are_those_of_the_closed_form():
    plate = Plate(SPRUCE, SIZE, THICKNESS)
    d_x, d_y, d_1, d_xy = rigidities(SPRUCE, THICKNESS)
    limit = 2.0 * np.pi * 2e4
    m, n, omega = plate.mode_numbers(limit)
    kx, ky = m * np.pi / SIZE[0], n * np.pi / SIZE[1]
    expected = np.sqrt(
        (d_x * kx**4 + 2.0 * (d_1 + 2.0 * d_xy) * kx**2 * ky**2 + d_y * ky**4)
        / (SPRUCE.density_kg_m3 * THICKNESS)
    )
    np.testing.assert_allclose(omega, expected, rtol=1e-12)
    assert np.all(np.diff(omega) >= 0.0)
    assert plate.fundamental_hz == pytest.approx(omega[0] / (2.0 * np.pi), rel=1e-12)
    # None is left out.
    every = np.arange(1, 400)
    a, b = np.meshgrid((every * np.pi / SIZE[0]) ** 2, (every * np.pi / SIZE[1]) ** 2)
    all_of = np.sqrt(
        (d_x * a * a + 2.0 * (d_1 + 2.0 * d_xy) * a * b + d_y * b * b)
        / (SPRUCE.density_kg_m3 * THICKNESS)
    )
    assert len(omega) == np.count_nonzero(all_of <= limit)
    modes = plate.modes(limit, POINT, OTHER)
    for shape, (x, y) in ((modes.at_contact, POINT), (modes.at_actuator, OTHER)):
        exact = np.sin(m * np.pi * x / SIZE[0]) * np.sin(n * np.pi * y / SIZE[1])
        np.testing.assert_allclose(shape, exact, atol=1e-12)


def test_two_simply_supported_edges_and_waves_agree():
    """The waves of a plate whose edges are all simply supported have no error of the corners."""
    plate, by_waves = Plate(SPRUCE, SIZE, THICKNESS), edged(SPRUCE, "ssss")
    limit = 2.0 * np.pi * 3e4
    exact, ours = (one.modes(limit, POINT, OTHER) for one in (plate, by_waves))
    low = by_waves.reached.low_modes
    assert low < 0.8 * len(ours.omega)
    np.testing.assert_allclose(ours.omega, exact.omega, rtol=1e-5)  # Ritz's at most
    np.testing.assert_allclose(ours.omega[low:], exact.omega[low:], rtol=1e-10)
    np.testing.assert_allclose(np.abs(ours.at_contact), np.abs(exact.at_contact), atol=1e-3)


@pytest.mark.parametrize("edges", default(["ffff", "cfff", "csff", "sfcf"], ["csff"]))
def test_an_isotropic_material_said_in_four_numbers_gives_the_same_plate(edges):
    limit = 2.0 * np.pi * 5e4
    one, other = (edged(m, edges, (0.5, 0.4)).modes(limit, POINT, OTHER) for m in (METAL, TURNED))
    elastic = one.omega > 1e-6
    np.testing.assert_allclose(other.omega[elastic], one.omega[elastic], rtol=1e-9)
    assert len(one.omega) == len(other.omega) > 500
    whole, turned = Plate(METAL, SIZE, THICKNESS), Plate(TURNED, SIZE, THICKNESS)
    assert turned.bending_stiffness_n_m == pytest.approx(whole.bending_stiffness_n_m, rel=1e-12)
    assert turned.rigidity.eta == pytest.approx(1.0, rel=1e-12)
    assert turned.residual_flexibility_m_n(limit, POINT) == pytest.approx(
        whole.residual_flexibility_m_n(limit, POINT), rel=1e-9
    )


@pytest.mark.full
@pytest.mark.parametrize(
    ("material", "edges"),
    [("birch_plywood", "csff"), *(("spruce", e) for e in ("ffff", "cfff", "csff", "cccc"))],
)
def test_finite_elements_have_the_same_frequencies(edges, material):
    pytest.importorskip("skfem")
    from tests.plant.structures.argyris import plate_squared

    of = MATERIALS[material]
    rigid = 3 if edges == "ffff" else 0
    d_x, d_y, d_1, d_xy = np.array(rigidities(of, THICKNESS)) / rigidities(of, THICKNESS)[0]
    squared = plate_squared(edges, SIZE, 0.0, 10 + rigid, 3, (d_x, d_y, d_1, d_xy))[rigid:]
    root = math.sqrt(rigidities(of, THICKNESS)[0] / (of.density_kg_m3 * THICKNESS))
    found = edged(of, edges).modes(3.0 * root * squared[-1], POINT, POINT).omega
    found = found[found > 1.0][:10]
    worst = np.abs(found / (root * squared) - 1.0).max()
    print(f"{material} {edges}: largest deviation {100 * worst:.2g} %")
    assert worst < 1e-3


@pytest.mark.parametrize("material", ["spruce", "birch_plywood"])
def test_the_high_modes_are_as_dense_and_mobile_as_the_infinite_plate(material):
    plate: Structure = Plate(MATERIALS[material], (1.3, 1.1), 0.004)
    limit = 2.0 * np.pi * 4e4
    modes = plate.modes(limit, (0.531, 0.472), (0.531, 0.472))
    expected = plate.modes_below(4e4)
    assert len(modes.omega) == pytest.approx(expected, rel=0.03)
    # Mean mobility of a band: sum of lambda phi^2 times pi/2 over its width.
    local = plate.local_plate
    mean = modes.scale_per_kg * np.sum(modes.at_contact**2) * np.pi / 2.0 / limit
    assert mean * local.infinite_plate_impedance_n_s_m == pytest.approx(1.0, rel=0.05)
    # 2/pi K((1 - eta)/2) is the mean over all directions.
    eta = local.rigidity.eta
    share = 0.5 * (1.0 - eta)
    whole = quad(lambda t: (1.0 - share * math.sin(2.0 * t) ** 2) ** -0.5, 0.0, math.pi / 2.0)[0]
    ratio = local.rigidity.mean_n_m / local.bending_stiffness_n_m
    assert math.sqrt(ratio) == pytest.approx(whole * 2.0 / math.pi, rel=1e-12)


def test_residual_flexibility_is_what_the_modes_beyond_add():
    plate = Plate(SPRUCE, SIZE, THICKNESS)
    low, high = 2.0 * np.pi * 4e3, 2.0 * np.pi * 4e4
    modes = plate.modes(high, POINT, POINT)
    between = modes.omega > low
    summed = modes.scale_per_kg * np.sum((modes.at_contact / modes.omega)[between] ** 2)
    left = plate.residual_flexibility_m_n(low, POINT) - plate.residual_flexibility_m_n(high, POINT)
    assert summed == pytest.approx(left, rel=0.01)


def test_a_turned_plate_is_the_same_plate():
    x, y = SPRUCE.young_x_pa, SPRUCE.young_y_pa
    across = replace(SPRUCE, young_x_pa=y, young_y_pa=x, poisson_xy=SPRUCE.poisson_xy * y / x)
    limit = 2.0 * np.pi * 3e3
    one = edged(SPRUCE, "csff").modes(limit, POINT, POINT)
    other = edged(across, "ffcs", SIZE[::-1]).modes(limit, POINT[::-1], POINT[::-1])
    np.testing.assert_allclose(one.omega, other.omega, rtol=1e-8)
    np.testing.assert_allclose(np.abs(one.at_contact), np.abs(other.at_contact), atol=1e-6)


WOOD = [
    "plate.material=spruce",
    "plate.size_m=[0.5,0.3]",
    "plate.contact_point_m=[0.21,0.13]",
    "plate.thickness_m=0.005",
    "run.duration_s=0.003",
]


def test_numbers_in_a_scene_are_those_of_the_name():
    named = load("aluminium-3mm", WOOD)
    said = ", ".join(f"{key} = {value!r}" for key, value in SHIPPED["spruce"].items())
    by_numbers = load("aluminium-3mm", [*WOOD, f"plate.material={{{said}}}"])
    assert named.structure == by_numbers.structure
    varied = named.vary({"plate.material.young_y_pa": 1.1e9})
    assert varied.scene.plant_tables.plate_material.young_y_pa == 1.1e9
    # The contact takes the modulus across the thickness.
    assert named.scene.plant_tables.plate_material.youngs_modulus_pa == 0.51e9


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"young_pa": 1e10}, "young_pa is of an isotropic material, young_x_pa of an orthotropic"),
        ({"shear_pa": None}, "shear_pa is missing"),
        ({"poisson_xy": 4.0}, "poisson_xy = 4 must be below"),
    ],
)
def test_numbers_that_make_no_material_are_refused(change, words):
    table = {**SHIPPED["spruce"], **change}
    with pytest.raises(ValueError, match=words):
        material_of("wood", {key: value for key, value in table.items() if value is not None})


def test_a_sphere_is_isotropic():
    with pytest.raises(SceneError, match=r"sphere\.material: is orthotropic"):
        load("aluminium-3mm", [*WOOD, "sphere.material=spruce"])
