"""The loop in contact, against the compiled kernels, and facts on laws without a linear loop."""

import json

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant import time_series as ts
from hertzloop.scene.build import build_plant
from hertzloop.scene.setup import load
from hertzloop.studies.margin.contact import contact_margin, impact_facts, plant_in_contact
from tests.commands import invoke

FORCE = ["controller.law=force_feedback", "sensors.quantity=contact_force"]


@pytest.mark.parametrize(
    ("scene", "settings", "rest_s"),
    [
        ("sylomer-20mm", [], 1.0),
        (
            "sylomer-20mm",
            ["contact.restitution=1", "contact.damping=none", "plate.loss_factor=0.1"],
            3.0,
        ),
        pytest.param("oak-20mm", [], 3.0, marks=pytest.mark.full),
    ],
)
def test_a_resting_sphere_answers_as_the_frozen_contact(scene, settings, rest_s):
    setup = load(scene, [*FORCE, *settings])
    plant = build_plant(setup.with_plate_model("modal"))
    for _ in range(int(rest_s * 10)):
        ts.series_under(plant, np.zeros(100_000))
    kept = [part.copy() for part in plant.state]
    count = 2000
    forces = 1e-3 * np.random.default_rng(1).standard_normal(count)
    pushed = ts.series_under(plant, forces)[ts.F_C]
    for part, before in zip(plant.state, kept, strict=True):
        part[...] = before
    resting = ts.series_under(plant, np.zeros(count))[ts.F_C]
    assert resting.min() > 0.0
    form, _ = plant_in_contact(setup, float(resting.mean()))
    i = np.arange(count)
    response = np.zeros(count)
    response[1:] = 2.0 * (form.poles[None, :] ** i[:-1, None] @ form.residues).real
    response[1:3] += form.fir
    expected = np.convolve(response, forces)[1:count]
    real = (pushed - resting)[:-1]
    # The force at rest still changes by 0.3 %, and the stiffness with it.
    assert np.abs(real - expected).max() < 5e-3 * np.abs(real).max()


def test_a_short_contact_gets_numbers_and_no_verdict():
    setup = load("aluminium-3mm", [*FORCE, "controller.kappa=0.8"])
    found = contact_margin(setup)
    assert not isinstance(found, str)
    assert found.touch.ends
    assert found.touch.contact_s == pytest.approx(29e-6, abs=1.1e-6)
    assert found.unstable_poles > 0
    assert found.growth_times_contact == pytest.approx(found.growth_per_s * found.touch.contact_s)
    assert found.growth_times_contact < 0.1
    assert found.stable is None


def test_a_resting_sphere_gets_a_verdict():
    setup = load("sylomer-20mm", [*FORCE, "controller.kappa=0.8"])
    found = contact_margin(setup)
    assert not isinstance(found, str)
    assert not found.touch.ends
    assert found.stable is True


def test_facts_on_a_threshold_law():
    setup = load("aluminium-3mm")
    found = impact_facts(setup)
    rows = simulate(setup).truth
    acts = int(np.flatnonzero(rows[ts.F_A])[0] - np.flatnonzero(rows[ts.F_C])[0])
    assert found.first_force_us == pytest.approx(acts)
    assert found.latency_after_contact_us == pytest.approx(1e6 * found.touch.contact_s - acts)


def test_the_command_points_to_the_budget(tmp_path):
    def margin(*words: str) -> tuple[dict, str]:
        done = invoke(["margin", "aluminium-3mm", *words, "--json", str(tmp_path / "m.json")])
        assert done.exit_code == 0, done.output
        return json.loads((tmp_path / "m.json").read_text()), " ".join(done.output.split())

    data, said = margin()
    assert "No margin: not a linear loop (it waits for a threshold" in said
    assert "hertzloop budget" in said
    assert f"first force {data['impact']['first_force_us']:.4g} us after the touch" in said
    assert data["contact"] is None
    _, said = margin("--law", "off")
    assert "so there is no loop. Name a law, for example --law velocity_feedback." in said
    assert "budget" not in said
    data, said = margin("--law", "force_feedback", "--set", "sensors.quantity=contact_force")
    assert "this says nothing for a contact this short" in said
    assert data["impact"] is None
    assert data["contact"]["stable"] is None
