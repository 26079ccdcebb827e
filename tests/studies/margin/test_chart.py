"""All closed-loop poles, the binding mode, and what the command writes."""

import numpy as np
import pytest
import scipy.signal as sg

from hertzloop.scene.setup import load
from hertzloop.studies.margin.binding import binding_mode, mode_line, mode_name
from hertzloop.studies.margin.chart import draw
from hertzloop.studies.margin.identify import law_filter
from hertzloop.studies.margin.linear import plant_in_flight
from hertzloop.studies.margin.margin import margin as analyse
from hertzloop.studies.margin.poles import closed_loop_poles
from hertzloop.studies.margin.table import Loop
from tests.commands import succeed
from tests.hertzloop.scenes import json_in
from tests.tiers import default

VELOCITY = ["controller.law=velocity_feedback"]
LEAKY = ["controller.law=acceleration_feedback", "controller.kappa=0.9"]
ROWS = "[[1.0, -1.9, 1.0, 1.0, -1.8, 0.9], [1.0, 0.5, 0.0, 1.0, 0.0, 0.0]]"
NOTCH = ["controller.law=linear", "controller.gain=-300", f"controller.sections={ROWS}"]
FIR = ["controller.law=linear", f"controller.numerator={(-30.0 * sg.firwin(21, 0.05)).tolist()}"]
CASES = {
    "oak": ("oak-20mm", [*VELOCITY, "controller.kappa=1.1"]),
    "leaky integral": ("oak-20mm", LEAKY),
    "filter": ("oak-20mm", NOTCH),
    "fir": ("oak-20mm", FIR),
    "aluminium": ("aluminium-20mm", [*VELOCITY, "controller.kappa=0.9"]),
    "actuator": (
        "aluminium-20mm",
        [*VELOCITY, "controller.kappa=0.4", "actuator.bandwidth_hz=20000"],
    ),
}


@pytest.mark.parametrize("name", default(CASES, ("oak", "filter", "fir")))
@pytest.mark.parametrize("delay", [1, 21, 200])
def test_all_poles_are_zeros_of_1_plus_l_and_as_many_as_the_table_says(name, delay):
    scene, settings = CASES[name]
    setup = load(scene, settings)
    loop = Loop(plant_in_flight(setup), law_filter(setup))
    poles = closed_loop_poles(loop.plant, loop.law, delay)
    assert np.sum(np.abs(poles) > 1.0) == loop.table.unstable(np.array([delay]))[0]
    away = np.abs(poles[:, None] - loop.plant.poles).min(axis=1)
    free = poles[(away > 1e-7) & (np.abs(poles) > 0.5)]
    assert len(free) > 20
    # Newton's step from a pole of the loop is as small as the rounding of 1 + L allows.
    gain = loop.gain(free) * free ** -float(delay)
    small = 1e-7 * away[(away > 1e-7) & (np.abs(poles) > 0.5)]
    beyond = loop.gain(free + small) * (free + small) ** -float(delay)
    assert np.abs((1.0 + gain) * small / (beyond - gain)).max() < 1e-9


def test_the_binding_mode_has_indices_and_frequency():
    setup = load("oak-20mm", [*VELOCITY, "controller.kappa=0.4"])
    found = binding_mode(setup, 790.9)
    assert found.indices is not None
    assert (7, 1) in {tuple(pair) for pair in found.indices}
    assert mode_name(found) == "modes (7, 1), (5, 5), (1, 7)"
    plate = setup.plant.plate.simply_supported
    m, n, omega = plate.mode_numbers(2.0 * np.pi * 800.0)
    expected = omega[(m == 7) & (n == 1)][0] / (2.0 * np.pi)
    assert found.frequency_hz == pytest.approx(expected, rel=1e-12)
    audible = (m % 2 == 1) & (n % 2 == 1)  # the others have a node at the centre
    lower = np.unique(np.round(omega[audible & (omega < 2.0 * np.pi * expected * 0.999)], 6))
    assert found.number == len(lower) + 1


def test_where_modes_overlap_or_the_omitted_ones_prevail_it_is_said():
    setup = load("oak-20mm", VELOCITY)
    assert binding_mode(setup, 400e3) is None
    assert "no single mode limits it" in mode_line(None, 400e3)
    overlapping = binding_mode(setup, 4623.6)
    assert overlapping is not None
    assert "as other modes overlap with it" in mode_line(overlapping, 4623.6)


@pytest.mark.parametrize("kappa", [0.4, 1.1])
def test_the_picture_shows_limit_and_state(kappa):
    setup = load("oak-20mm", [*VELOCITY, f"controller.kappa={kappa}"])
    result = analyse(setup)
    sheet = draw(setup, result)
    gain, nyquist = sheet.axes
    assert ("unstable" if kappa > 1.0 else "stable") in sheet.get_suptitle()
    assert (
        f"{result.flight.binding_frequency_hz:.4g} Hz"
        in gain.get_legend().get_texts()[0].get_text()
    )
    [line] = [one for one in nyquist.lines if one.get_label() == "L"]
    assert np.isfinite(line.get_xydata()).all()


def test_the_command_writes_picture_numbers_and_plant(tmp_path):
    words = ["--law", "velocity_feedback", "--set", "controller.kappa=0.4"]
    said = succeed("margin", "oak-20mm", *words, "--out-dir", tmp_path / "out")
    assert "stable in flight at 0 us: it tolerates a latency of up to 497" in said
    assert "limited by modes (7, 1), (5, 5), (1, 7) at 770.3" in said
    data = json_in(tmp_path / "out" / "margin.json")
    assert data["binding_mode"]["indices"] == [[7, 1], [5, 5], [1, 7]]
    assert (tmp_path / "out" / "margin.png").read_bytes()[:4] == b"\x89PNG"
    plant = np.load(tmp_path / "out" / "plant.npz")
    assert np.sum(plant["poles"].imag >= 0.0) == data["modes"] + 1  # that of the truncated modes


def test_the_command_points_to_the_budget(tmp_path):
    def margin(*words: str) -> str:
        said = succeed("margin", "aluminium-3mm", *words, "--json", tmp_path / "m.json")
        assert json_in(tmp_path / "m.json")["applicable"] is False
        return said

    said = margin()
    assert "No margin: not a linear loop (it waits for a threshold" in said
    assert "hertzloop budget" in said
    said = margin("--law", "off")
    assert "so there is no loop. Name a law, for example --law velocity_feedback." in said
    assert "budget" not in said
    assert "The law has no linear loop in flight, so it has no margin." in said
    said = margin("--law", "force_feedback", "--set", "sensors.quantity=contact_force")
    assert "the contact force is zero in flight" in said
    assert "hertzloop budget" in said
