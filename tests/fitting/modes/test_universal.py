"""Modes of universal files: units, directions, scales, complex shapes, and what is refused."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.modes.file_units import units_given, units_of
from hertzloop.fitting.modes.universal_file import Points
from hertzloop.fitting.modes.universal_modes import modes_of_sets
from hertzloop.loop.simulate import simulate
from hertzloop.plant.structures.mode_file import read_modes, write_modes
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.setup import load
from tests.commands import as_options, invoke

FILE = Path("test.unv")
HZ, MASS, LOSS = np.array([120.0, 310.0, 705.0]), np.array([0.2, 1.0, 0.7]), 0.004
SHAPES = np.array([[0.5, 0.3, 0.1], [1.0, -0.2, 0.4], [-0.8, 0.6, 0.9]])  # modes, nodes 7, 9, 12
SI = units_given("m,N")
POINTS = Points(contact=7, actuator=9, sensor=12)


def normal(mode: int, **changes: Any) -> dict[str, Any]:
    """A data set 55 of a mode that moves along z."""
    flat = np.zeros(3)
    return {
        "type": 55,
        "analysis_type": 2,
        "spec_data_type": 8,
        "freq": HZ[mode],
        "modal_m": MASS[mode],
        "modal_damp_vis": LOSS / 2,
        "modal_damp_his": 0.0,
        "node_nums": np.array([7.0, 9.0, 12.0]),
        "r1": flat,
        "r2": flat,
        "r3": SHAPES[mode],
    } | changes


def modes(sets: list[dict[str, Any]], points: Points = POINTS, **options: Any) -> Any:
    return modes_of_sets(sets, FILE, points, options.pop("units", SI), **options)


def test_normal_modes_come_as_they_are():
    table = modes([normal(2), normal(0), normal(1)]).table
    assert np.allclose(table.omega_rad_s, 2 * np.pi * HZ, rtol=1e-15)
    assert np.allclose(table.loss_factor, LOSS, rtol=1e-15)
    assert np.allclose(table.per_modal_mass_1_kg, 1 / MASS, rtol=1e-15)
    for found, expected in zip(
        (table.shape_contact, table.shape_actuator, table.shape_sensor), SHAPES.T, strict=True
    ):
        assert np.array_equal(found, expected)


@pytest.mark.parametrize(
    ("code", "length", "force", "mass_kg"),
    [(1, 1.0, 1.0, 1.0), (10, 1e3, 1.0, 1e3), (7, 39.3700787, 0.2248089431, 175.126835)],
)
def test_the_units_of_the_file_are_converted(code, length, force, mass_kg):
    stated = {"type": 164, "units_code": code, "length": length, "force": force}
    units = units_of([stated], FILE, None)
    assert units.mass_kg == pytest.approx(mass_kg, rel=1e-6)
    heavier = modes([normal(0)], units=units).table.per_modal_mass_1_kg
    assert heavier[0] == pytest.approx(1 / (MASS[0] * mass_kg), rel=1e-6)


def test_units_that_cannot_be_known_are_refused():
    assert units_of([normal(0)], FILE, None) is None
    with pytest.raises(ModalDataError, match=r"no data set 164, .* Give --units m,N"):
        modes([normal(0)], units=None)
    with pytest.raises(ModalDataError) as refused:
        modes([normal(0, modal_m=0.0, r1=SHAPES[0])], units=None)
    for part in ("--units m,N", "--direction: is missing", "--unit-modal-mass"):
        assert part in str(refused.value)
    # The example in pyuff's documentation: the code of SI with the factors of foot and pound.
    foot = {"type": 164, "units_code": 1, "length": 3.28083989501312, "force": 0.224808943}
    with pytest.raises(ModalDataError, match=r"the code 1 of m and N, but the factors 3\.28"):
        units_of([foot], FILE, None)
    slug = units_of([foot], FILE, "ft,lbf")
    assert slug.mass_kg == pytest.approx(14.5939, rel=1e-5)
    with pytest.raises(ModalDataError, match="--units = metric: must be a length and a force"):
        units_of([], FILE, "metric")


def test_complex_modes_are_those_normal_modes():
    """With modal a = 2 j w_d m, a shape turned by any phase, and none turned within itself."""
    omega = 2 * np.pi * HZ
    poles = omega * (-LOSS / 2 + 1j * np.sqrt(1 - LOSS**2 / 4))
    sets = [
        normal(
            i,
            analysis_type=7,
            eig=poles[i],
            modal_a=2j * poles[i].imag * MASS[i] * turn**2,
            r3=SHAPES[i] * turn,
        )
        for i, turn in enumerate(np.exp([0.3j, 2j, -1j]))
    ]
    found = modes(sets)
    table = found.table
    assert found.most_complex < 1e-12
    assert np.allclose(table.omega_rad_s, omega, rtol=1e-14)
    assert np.allclose(table.loss_factor, LOSS, rtol=1e-12)
    own = table.shape_contact**2 * table.per_modal_mass_1_kg
    assert np.allclose(own, SHAPES[:, 0] ** 2 / MASS, rtol=1e-12)
    across = table.shape_contact * table.shape_sensor * table.per_modal_mass_1_kg
    assert np.allclose(across, SHAPES[:, 0] * SHAPES[:, 2] / MASS, rtol=1e-12)


def test_how_near_to_real_is_told_and_far_is_refused():
    near = modes([normal(0, r3=SHAPES[0] * (1 + 0.02j * np.array([1, -1, 1])))])
    assert near.most_complex == pytest.approx(0.02, rel=0.5)
    assert np.allclose(
        np.abs(near.table.shape_contact) / np.sqrt(MASS[0]), 0.5 / MASS[0], rtol=1e-2
    )
    with pytest.raises(ModalDataError, match=r"mode 1 \(120 Hz\) is far from a real one"):
        modes([normal(0, r3=SHAPES[0] * np.array([1, 1j, 1]))])


def test_modes_of_a_finite_element_program():
    """Data set 2414, as pyuff reads it."""
    one = {
        "type": 2414,
        "analysis_type": 2,
        "dataset_location": 1,
        "result_type": 8,
        "data_type": 2,
        "node_nums": np.array([7, 9]),
        "data_at_node": [np.array([0, 0, 0.5, 0, 0, 0]), np.array([0, 0, 0.3, 0, 0, 0])],
        "record12_field2": 120.0,
        "record12_field4": 0.2,
        "record12_field6": LOSS,
    }
    table = modes([one], Points(7, 9)).table
    assert table.shape_contact[0] == 0.5
    assert table.shape_actuator[0] == 0.3
    assert table.per_modal_mass_1_kg[0] == 5.0
    assert table.loss_factor[0] == LOSS
    assert table.shape_sensor is None


@pytest.mark.parametrize(
    ("sets", "points", "options", "sentence"),
    [
        ([], POINTS, {}, "holds no modes at nodes"),
        (
            [normal(0)],
            Points(8),
            {},
            "--contact = 8: not a node .* Its nodes are 7, 9, 12",
        ),
        ([normal(0, modal_m=0.0)], POINTS, {}, "modal mass of mode 1 .* Add --unit-modal-mass"),
        ([normal(0, r1=SHAPES[0])], POINTS, {}, "--direction: is missing, .* directions x, z"),
        ([normal(0, spec_data_type=12)], POINTS, {}, "shapes are of acceleration"),
        ([normal(0)], POINTS, {"loss_factor": 0.1}, "--loss-factor = 0.1: .* a damping for each"),
    ],
)
def test_what_is_refused(sets, points, options, sentence):
    with pytest.raises(ModalDataError, match=sentence):
        modes(sets, points, **options)


def test_what_an_option_settles():
    table = modes([normal(0, modal_m=0.0)], unit_mass=True).table
    assert table.per_modal_mass_1_kg[0] == 1.0
    undamped = normal(0, modal_damp_vis=0.0)
    assert modes([undamped]).undamped
    assert modes([undamped], loss_factor=0.01).table.loss_factor[0] == 0.01
    skewed = normal(0, r1=2 * SHAPES[0])
    x = modes([skewed], Points(7, direction="x")).table
    assert x.shape_contact[0] == 2 * SHAPES[0, 0]


def six_digits(values: np.ndarray) -> np.ndarray:
    """What the format of data set 55 holds."""
    return np.array([float(f"{value:.5e}") for value in values])


@pytest.mark.full
def test_modes_of_a_shipped_scene_by_pyuff_give_the_same_recording(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    scene = load("offcentre-6mm")
    known = modes_of_scene(scene)
    columns = {
        "frequency_hz": six_digits(known.omega_rad_s / (2 * np.pi)),
        "loss_factor": 2 * six_digits(known.loss_factor / 2 + 0 * known.omega_rad_s),
        "modal_mass_kg": six_digits(1 / known.per_modal_mass_1_kg),
        "shape_contact": six_digits(known.shape_contact),
        "shape_actuator": six_digits(known.shape_actuator),
    }
    sets = [
        pyuff.prepare_164(
            units_code=9,
            units_description="mm, N",
            temp_mode=1,
            length=1e3,
            force=1.0,
            temp=1.0,
            temp_offset=273.15,
        )
    ]
    flat = np.zeros(2)
    for i, (hz, loss, mass, *shape) in enumerate(zip(*columns.values(), strict=True)):
        sets.append(
            pyuff.prepare_55(
                model_type=1, id1="NONE", id2="NONE", id3="NONE", id4="NONE", id5="NONE",
                analysis_type=2, data_ch=2, spec_data_type=8, load_case=0, mode_n=i + 1,
                freq=float(hz), modal_m=float(mass) / 1e3, modal_damp_vis=float(loss) / 2,
                modal_damp_his=0.0, node_nums=[1, 2], r1=flat, r2=flat, r3=np.array(shape),
            )
        )  # fmt: skip
    pyuff.UFF(str(tmp_path / "modes.uff")).write_sets(sets, "overwrite")
    np.savez(
        tmp_path / "direct.npz", residual_flexibility_m_n=known.residual_flexibility_m_n, **columns
    )
    short = ["run.duration_s=0.004", "run.accuracy=0.01"]
    settings = [*short, f"plate.residual_flexibility_m_n={known.residual_flexibility_m_n!r}"]
    done = invoke(
        ["scene", "modes", "offcentre-6mm", "--from", str(tmp_path / "modes.uff"), "--contact",
         "1", "--actuator", "2", "-o", str(tmp_path / "of-file.csv"),
         *as_options(settings)]
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "312 modes from 277.01 to 52600 Hz" in done.output
    base = "offcentre-6mm with run.duration_s=0.004, run.accuracy=0.01, plate.residual"
    assert f"law of {base}" in done.output
    assert f"all else from {base}" in (tmp_path / "of-file.toml").read_text("utf-8")
    assert "Direction z, units of the file: 1/1000 m and 1/1 N" in done.output
    of_file = load(str(tmp_path / "of-file.toml"))
    direct = load(str(tmp_path / "of-file.toml"), [f"plate.modes={tmp_path / 'direct.npz'}"])
    rows, others = simulate(of_file).truth, simulate(direct).truth
    largest = np.abs(others).max(axis=1, keepdims=True)
    assert np.all(np.abs(rows - others) <= 1e-9 * largest)
    original = simulate(load("offcentre-6mm", short)).truth
    assert 1e-9 < np.max(np.abs(rows - original) / np.maximum(largest, 1e-300)) < 1e-1


def test_the_column_of_the_sensor_survives_a_file(tmp_path):
    table = modes([normal(0), normal(1)]).table
    for suffix in (".csv", ".parquet", ".npz"):
        again = read_modes(f"m{suffix}", write_modes(suffix, table))
        assert np.array_equal(again.shape_sensor, table.shape_sensor)


def test_the_command_refuses_what_it_cannot_mean():
    for words, sentence in [
        (["--contact", "3"], "--contact: describes a measured structure. Add --from FILE"),
        (["--from", "none.uff"], "--contact: is missing"),
        (["--from", "none.uff", "--contact", "a"], "--contact = a: is not the number of a node"),
        (["--from", "none.uff", "--grid", "--contact", "1"], "--grid: measured modes have no"),
        (
            ["--from", "none.uff", "--contact", "1"],
            "there is no such file" if find_spec("pyuff") else "this needs pyuff",
        ),
        (["aluminium-3mm", "oak-20mm"], "is more than one scene"),
    ]:
        done = invoke(["scene", "modes", *words])
        assert done.exit_code == 2, done.output
        assert sentence in done.output
