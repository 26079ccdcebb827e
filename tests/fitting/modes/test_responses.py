"""Modes from frequency responses: accuracy, units, and what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.modes.file_units import units_given, units_of
from hertzloop.fitting.modes.from_responses import modes_of_responses
from hertzloop.fitting.modes.response_sets import responses_of_sets
from hertzloop.fitting.modes.universal_file import Points, holds_modes
from hertzloop.plant.structures.mode_file import read_modes
from hertzloop.results.scene_modes import modes_of_scene
from hertzloop.scene.setup import load
from tests.commands import invoke
from tests.fitting.modes.known import (
    CONTACT,
    FLEXIBILITY,
    KNOWN,
    LOSS,
    OTHER,
    near,
    response,
    silent,
)

FILE = Path("test.uff")
SI = units_given("m,N")


def data_set(node: int, values: np.ndarray, hz: np.ndarray, **changes: Any) -> dict[str, Any]:
    return {
        "type": 58, "func_type": 4, "rsp_node": node, "rsp_dir": 3, "ref_node": 1, "ref_dir": 3,
        "ordinate_spec_data_type": 12, "orddenom_spec_data_type": 13, "x": hz, "data": values,
        "ordinate_axis_units_lab": "m/s^2", "orddenom_axis_units_lab": "N",
    } | changes  # fmt: skip


def two_sets(**changes: Any) -> list[dict[str, Any]]:
    hz = np.arange(20.0, 1500.0, 4.0)
    return [
        data_set(1, response(KNOWN, hz, CONTACT, 2), hz, **changes),
        data_set(2, response(KNOWN, hz, OTHER, 2), hz, **changes),
    ]


def taken(sets: list[dict[str, Any]], points: Points, **options: Any) -> Any:
    return responses_of_sets(
        sets, FILE, points, options.get("units"), options.get("kind"), options.get("reference")
    )


def test_exact_responses_give_the_very_modes():
    points = Points(contact=1, actuator=2, sensor=2)
    found = modes_of_responses(taken(two_sets(), points), None, points, silent)
    table = found.table
    assert np.allclose(table.omega_rad_s, KNOWN.omega_rad_s, rtol=1e-9)
    assert np.allclose(table.loss_factor, LOSS, rtol=1e-6)
    assert np.allclose(table.shape_contact, CONTACT, rtol=1e-6)
    assert np.allclose(table.shape_actuator, OTHER, rtol=1e-6)
    assert np.array_equal(table.shape_sensor, table.shape_actuator)
    assert table.residual_flexibility_m_n == pytest.approx(FLEXIBILITY, rel=1e-4)
    assert max(one.rms for one in found.held_out) < 1e-4
    assert found.notes == ()


def test_a_reference_elsewhere_scales_by_its_own_response():
    """The force was at node 1; contact and actuator are at node 2."""
    points = Points(contact=2)
    found = modes_of_responses(taken(two_sets(), points), None, points, silent)
    assert np.allclose(found.table.shape_contact, OTHER, rtol=1e-6)
    assert found.table.residual_flexibility_m_n is None


def test_kinds_units_and_signs():
    points = Points(contact=1)
    straight = taken(two_sets()[:1], points)
    hz = straight.hz
    in_g = data_set(1, straight.values[0] / 9.80665, hz, ordinate_axis_units_lab="g")
    assert np.allclose(taken([in_g], points).values, straight.values, rtol=1e-12)
    turned = data_set(1, -straight.values[0], hz, rsp_dir=-3)
    assert np.allclose(taken([turned], points).values, straight.values, rtol=1e-12)
    in_mm = data_set(1, 1e3 * straight.values[0], hz, ordinate_axis_units_lab="")
    units = units_given("mm,N")
    assert np.allclose(taken([in_mm], points, units=units).values, straight.values, rtol=1e-12)
    receptance = response(KNOWN, hz, CONTACT, 0)
    unsaid = data_set(
        1,
        receptance,
        hz,
        ordinate_spec_data_type=0,
        orddenom_spec_data_type=0,
        ordinate_axis_units_lab="",
        orddenom_axis_units_lab="",
    )
    known = taken([unsaid], points, units=SI, kind="receptance")
    assert known.order == 0
    assert np.allclose(known.values[0], receptance)


def test_units_of_labels_are_those_of_records():
    straight = taken(two_sets()[:1], Points(1))
    for label, force, factor in (
        ("(m/s^2)/N", "kN", 1e-3),
        ("MM/S^2", "N", 1e-3),
        ("ft/s^2", "LBF", 0.3048 / 4.4482216152605),
    ):
        one = data_set(
            1,
            straight.values[0],
            straight.hz,
            ordinate_axis_units_lab=label,
            orddenom_axis_units_lab=force,
        )
        assert np.allclose(taken([one], Points(1)).values, factor * straight.values, rtol=1e-12)
    unclear = data_set(1, straight.values[0], straight.hz, orddenom_axis_units_lab="MN")
    with pytest.raises(ModalDataError, match="no labels of units that are known"):
        taken([unclear], Points(1))


@pytest.mark.parametrize(
    ("change", "points", "sentence"),
    [
        (
            {"ordinate_spec_data_type": 0, "ordinate_axis_units_lab": ""},
            Points(1),
            "does not say whether .* Give --kind receptance, mobility, accelerance",
        ),
        (
            {"ordinate_axis_units_lab": "", "orddenom_axis_units_lab": ""},
            Points(1),
            "no data set 164 and no labels .* Give --units m,N",
        ),
        ({"ordinate_axis_units_lab": "m/s"}, Points(1), "of accelerance by its type, but"),
        ({"rsp_dir": 4}, Points(1), "no response along the direction of its force"),
        ({}, Points(5), "--contact = 5: .* has those of the nodes 1, 2"),
        ({"ref_node": 9}, Points(1), "--reference = 9: .* no response of this node itself"),
    ],
)
def test_responses_that_are_refused(change, points, sentence):
    with pytest.raises(ModalDataError, match=sentence):
        taken(two_sets(**change), points)


def test_what_a_file_leaves_open_is_refused_with_the_choices():
    sets = two_sets()
    along_x = data_set(1, sets[0]["data"], sets[0]["x"], rsp_dir=1, ref_dir=1)
    with pytest.raises(ModalDataError, match=r"--direction: is missing, .* directions x, z"):
        taken([*sets, along_x], Points(1))
    other = data_set(2, sets[1]["data"], sets[1]["x"], ref_node=2)
    with pytest.raises(ModalDataError, match=r"--reference: is missing, .* nodes 1, 2"):
        taken([*sets, other], Points(1))
    assert taken([*sets, other], Points(1), reference=1).nodes == (1,)
    with pytest.raises(ModalDataError, match="several responses of node 1"):
        taken([*sets, sets[0]], Points(1))
    inch = units_of(
        [{"type": 164, "units_code": 7, "length": 39.37007874, "force": 0.2248089431}], FILE, None
    )
    with pytest.raises(ModalDataError, match="but a response has the labels m/s\\^2 and N"):
        taken(sets, Points(1), units=inch)
    with pytest.raises(ModalDataError, match=r"--kind: is missing, .* modes and frequency"):
        holds_modes([{"type": 55}, *sets], None, FILE)


def test_everything_that_is_missing_is_named_at_once():
    unsaid = two_sets(
        ordinate_axis_units_lab="", orddenom_axis_units_lab="", ordinate_spec_data_type=0
    )
    along_x = data_set(1, unsaid[0]["data"], unsaid[0]["x"], rsp_dir=1, ref_dir=1)
    other = data_set(2, unsaid[1]["data"], unsaid[1]["x"], ref_node=2)
    for some, parts in [
        ([*unsaid, along_x, other], ["--direction", "--reference", "--kind", "--units m,N"]),
        (unsaid, ["--kind", "--units m,N"]),
    ]:
        with pytest.raises(ModalDataError) as refused:
            taken(some, Points(1))
        assert all(part in str(refused.value) for part in parts)


@pytest.mark.full
@pytest.mark.parametrize("order", [1, 2], ids=["mobility", "accelerance"])
def test_responses_of_a_shipped_scene_by_pyuff(order, tmp_path):
    """The promise: at 0.1 % noise, up to 5 kHz, frequencies to 1e-5, damping to 1 %, shapes to
    0.5 %."""
    pyuff = pytest.importorskip("pyuff")
    known = modes_of_scene(load("offcentre-6mm"))
    hz, rng = np.arange(5.0, 6000.0, 0.5), np.random.default_rng(order)
    sets = [
        pyuff.prepare_164(
            units_code=5,
            units_description="mm, mN",
            temp_mode=1,
            length=1e3,
            force=1e3,
            temp=1.0,
            temp_offset=273.15,
        )
    ]
    for node, shape in ((1, known.shape_contact), (2, known.shape_actuator)):
        values = response(known, hz, shape, order)
        noise = rng.standard_normal((2, len(hz))) / np.sqrt(2)
        values = values * (1 + 1e-3 * (noise[0] + 1j * noise[1]))
        kind = {"ordinate_spec_data_type": (8, 11, 12)[order], "abscissa_spec_data_type": 18}
        plain = {"id1": "NONE", "rsp_ent_name": "NONE", "ref_ent_name": "NONE", "binary": 0}
        unsaid = {"ordinate_axis_units_lab": "NONE", "orddenom_axis_units_lab": "NONE"}
        sets.append(data_set(node, values, hz, **kind, **plain, **unsaid, abscissa_spacing=1))
    pyuff.UFF(str(tmp_path / "frf.uff")).write_sets(sets, "overwrite")
    done = invoke(
        ["scene", "modes", "offcentre-6mm", "--from", str(tmp_path / "frf.uff"), "--contact", "1",
         "--actuator", "2", "-o", str(tmp_path / "frf.csv"), "--set", "plate.thickness_m=0.003"]
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    table = read_modes("frf.csv", (tmp_path / "frf.csv").read_bytes())
    below = known.omega_rad_s < 2 * np.pi * 5000
    found = [near(table, omega / (2 * np.pi)) for omega in known.omega_rad_s[below]]
    mass = np.sqrt(known.per_modal_mass_1_kg[below])
    sign = np.sign(known.shape_contact[below])
    for name, values, expected, most in [
        ("frequency", table.omega_rad_s, known.omega_rad_s[below], 1e-5),
        ("damping", table.loss_factor, known.loss_factor[below], 1e-2),
        ("contact", table.shape_contact, mass * np.abs(known.shape_contact[below]), 5e-3),
        ("actuator", table.shape_actuator, mass * sign * known.shape_actuator[below], 5e-3),
    ]:
        assert np.max(np.abs(values[found] / expected - 1)) < most, name
