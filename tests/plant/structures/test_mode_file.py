"""Files of modes: what is read is what was written; what is wrong ends in one sentence."""

import io
import math
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.modal_structure import ModalStructure
from hertzloop.plant.structures.mode_file import (
    SUFFIXES,
    ModeTable,
    read_modes,
    write_modes,
)
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.structure import oscillators

GOOD = """# residual_flexibility_m_n = 2.5e-9
frequency_hz,loss_factor,modal_mass_kg,shape_contact,shape_actuator
120.5,0.01,0.4,1.0,0.3
300,0.02,0.5,-0.6,0.2
300,0.02,0.5,0.4,0.9
"""


def table_of(text: str = GOOD) -> ModeTable:
    return read_modes("m.csv", text.encode())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_written_is_read(suffix):
    random = np.random.default_rng(3)
    x, y = np.linspace(0.0, 1.0, 4), np.linspace(0.0, 2.0, 3)
    table = ModeTable(
        np.sort(random.uniform(1e2, 1e6, 7)),
        random.uniform(0.0, 0.1, 7),
        random.uniform(0.1, 9.0, 7),
        random.normal(size=7),
        random.normal(size=7),
        1.1e-9,
        (x, y, random.normal(size=(7, 4, 3))),
    )
    found = read_modes(f"m{suffix}", write_modes(suffix, table))
    for name in (
        "omega_rad_s",
        "loss_factor",
        "per_modal_mass_1_kg",
        "shape_contact",
        "shape_actuator",
        "residual_flexibility_m_n",
    ):
        assert np.array_equal(getattr(found, name), getattr(table, name)), name
    assert (found.grid is not None) == (suffix == ".npz")
    if found.grid is not None and table.grid is not None:
        assert all(np.array_equal(a, b) for a, b in zip(found.grid, table.grid, strict=True))


def test_five_columns_are_enough():
    table = table_of()
    assert table.omega_rad_s[0] == 2.0 * math.pi * 120.5
    assert table.residual_flexibility_m_n == 2.5e-9
    found = oscillators(ModalStructure("m.csv", table, MATERIALS["steel"]), (0, 0), (0, 0), 1e9)
    # One mode, and a pair of one frequency, that two points see as two.
    assert (found.modes, len(found.omega)) == (3, 3)
    pair = slice(1, 3)
    for a, b, at in ((found.contact, found.contact, 0.52), (found.contact, found.actuator, 0.24)):
        assert found.scale_per_kg * np.sum((a * b)[pair]) == pytest.approx(at / 0.5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("frequency_hz", "frequency", "no column frequency_hz ('frequency' has another unit"),
        ("loss_factor,", "eta,", "no column loss_factor"),
        ("120.5", "nan", "frequency_hz of mode 1 is nan"),
        ("120.5", "x", "frequency_hz of mode 1 is x; it must be 0 to 1e9 Hz"),
        ("120.5", "400", "frequencies must rise, but mode 2 has 300 Hz after 400 Hz"),
        ("0.4,1.0", "0,1.0", "modal_mass_kg of mode 1 is 0; it must be above 0"),
        ("120.5,0.01", "120.5,-0.01", "loss_factor of mode 1 is -0.01; it must be 0 to 1"),
        ("0.4,1.0,0.3", "0.4,1.0", "line 3: 4 values under 5 headings"),
        ("0.4,1.0,0.3", "0.4,inf,0.3", "shape_contact of mode 1 is inf"),
        ("2.5e-9", "-1", "residual_flexibility_m_n of mode 1 is -1"),
    ],
)
def test_wrong_files_end_in_one_sentence(old, new, words):
    with pytest.raises(ValueError, match=r"m\.csv") as caught:
        table_of(GOOD.replace(old, new, 1))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("m.txt", b"", "m.txt is not a file of modes; its name must end in .csv, .npz"),
        ("m.csv", b"", "has no column frequency_hz"),
        ("m.csv", GOOD.encode().split(b"120.5")[0], "holds no mode"),
        ("m.csv", b"frequency_hz\xff\xfe", "is not in UTF-8: byte 0xff in line 1"),
        ("m.npz", b"nonsense", "cannot be read as npz"),
    ],
)
def test_files_that_are_none(name, content, words):
    with pytest.raises(ValueError, match=name) as caught:
        read_modes(name, content)
    assert words in str(caught.value)


def test_a_grid_must_fit():
    def of(**changed: np.ndarray) -> ModeTable:
        arrays = {
            "frequency_hz": np.array([10.0, 20.0]),
            "loss_factor": np.zeros(2),
            "modal_mass_kg": np.ones(2),
            "shape_contact": np.ones(2),
            "x_m": np.arange(3.0),
            "y_m": np.arange(4.0),
            "shape_grid": np.zeros((2, 3, 4)),
        } | changed
        out = io.BytesIO()
        np.savez(out, **arrays)
        return read_modes("m.npz", out.getvalue())

    assert of().grid is not None
    with pytest.raises(ValueError, match="not \\(modes, x, y\\)"):
        of(shape_grid=np.zeros((2, 4, 3)))
    with pytest.raises(ValueError, match="x_m must rise"):
        of(x_m=np.zeros(3))
    with pytest.raises(ValueError, match="one row a mode"):
        of(loss_factor=np.zeros(3))


PLATE = Plate(MATERIALS["aluminium"], (0.5, 0.4), 0.003)


def of_plate(hz: float = 1.0, kg: float = 1.0) -> ModeTable:
    """A plate's modes with frequencies and masses in other units."""
    modes = PLATE.modes(2.0 * np.pi * 2e4, (0.2, 0.17), (0.2, 0.17))
    count = len(modes.omega)
    return ModeTable(
        hz * modes.omega,
        np.zeros(count),
        np.full(count, modes.scale_per_kg / kg),
        modes.at_contact,
        modes.at_contact,
    )


def test_a_plate_by_its_modes_is_as_mobile_and_as_soft_as_the_plate():
    structure = ModalStructure("m.csv", of_plate(), PLATE.material, PLATE)
    assert structure.mobility_ratio == pytest.approx(1.0, rel=0.1)
    limit = 2.0 * np.pi * 5e3
    assert structure.residual_flexibility_m_n(limit) == pytest.approx(
        PLATE.residual_flexibility_m_n(limit, (0.2, 0.17)), rel=0.03
    )
    elsewhere = PLATE.modes(2.0 * np.pi * 2e4, (0.31, 0.12), (0.31, 0.12)).at_contact
    there = replace(structure, mode_table=replace(of_plate(), shape_actuator=elsewhere))
    assert there.struck_at_actuator.residual_flexibility_m_n(limit) == pytest.approx(
        PLATE.residual_flexibility_m_n(limit, (0.31, 0.12)), rel=0.03
    )
    given = ModalStructure("m.csv", of_plate(), PLATE.material, PLATE, 3e-8)
    assert given.residual_flexibility_m_n(1e9) == 3e-8


@pytest.mark.parametrize(("hz", "kg"), [(1e3, 1.0), (1.0, 1e-3)])
def test_a_unit_wrong_by_a_thousand_is_noticed(hz, kg):
    with pytest.raises(ValueError, match="frequency_hz must be in Hz, modal_mass_kg in kg"):
        ModalStructure("m.csv", of_plate(hz, kg), PLATE.material, PLATE)


def test_somebody_must_say_what_the_modes_left_out_are_worth():
    with pytest.raises(ValueError, match="residual_flexibility_m_n of the truncated modes"):
        ModalStructure("m.csv", of_plate(), PLATE.material)
