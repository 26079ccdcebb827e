"""The scheme of the benchmarks: its order, its energy, and a run by the interface for schemes."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import integrator_kernels as ik
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant, known_to_scenes
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.simulate import simulate
from hertzloop.plant.contact.hertz import Contact
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.time_series import XI
from hertzloop.recordings.reader import read
from hertzloop.results.verification import verify
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from tests.plant.rigs import run, spec
from tests.plant.test_collocation import CASES
from tests.plant.test_solution import reference

STEPS_S = (1e-6, 5e-7, 2.5e-7, 1.25e-7)
CONTACT_S = 40e-6  # longer than any contact below


@pytest.mark.parametrize("case", CASES)
def test_gap_converges_as_the_step_squared(case):
    changes, push = CASES[case]
    t = STEPS_S[-1] * np.arange(1, round(CONTACT_S / STEPS_S[-1]) + 1)
    solution = reference(spec(**changes), lambda _: np.asarray(push), t)
    errors = []
    for h in STEPS_S:
        plant = DiscreteGradientPlant(spec(step_s=h, lead_in_s=0.0, **changes))
        steps, every = round(CONTACT_S / h), round(h / STEPS_S[-1])
        gaps = run(plant, steps, np.full(steps, push)).xi[1:]
        errors.append(abs(gaps - solution[every - 1 : -every : every]).max() / -solution.min())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    print(f"{case}: {len(plant.modes.omega)} frequencies, errors {errors}, orders {orders}")
    assert solution[-1] > 0.0  # a whole contact
    assert 1.8 < orders.mean() < 2.2


@pytest.mark.parametrize("beside", [None, (0.3, 0.21)])
def test_energy_and_momentum_are_kept_under_a_random_force(beside):
    random = np.random.default_rng(11)
    force = np.repeat(random.standard_normal(80) * (random.random(80) < 0.5), 50)
    plant = DiscreteGradientPlant(
        spec(loss_factor=0.05, actuator_point_m=beside, drop_height_m=1e-4)
    )
    run(plant, len(force), force)
    balance = plant.close_balance()
    assert balance.contact_steps > 0
    assert balance.modal_dissipated_j > 0.1 * abs(balance.injected_j)
    assert abs(balance.energy_residual) < 1e-10
    assert abs(balance.momentum_residual) < 1e-10


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_the_energy_of_a_stiff_contact_is_kept(share):
    """A contact of 0.3 us: the slowest mode turns by 1e-6 in a step, where a difference of
    exponentials would cancel."""
    base = spec(contact=Contact(4.4e14), loss_factor=0.0)
    plant = DiscreteGradientPlant(replace(base, step_s=share * 2.9e-7, lead_in_s=0.0))
    run(plant, round(3.0 / share))
    balance = plant.close_balance()
    assert balance.contact_steps > 3
    assert balance.contact_j == 0.0
    assert abs(balance.energy_residual) < 1e-12


@pytest.mark.full
def test_a_scene_runs_by_it_as_the_charts_do(tmp_path):
    keys = ["run.scheme=discrete_gradient", "run.duration_s=0.0013", "run.accuracy=0.1"]
    with known_to_scenes():
        free = load("aluminium-3mm", [*keys, "controller.law=off"])
        rows = simulate(free).truth
        gaps = np.empty(free.steps - 1)
        plant = DiscreteGradientPlant(free.plant)
        ik.plant_gaps(plant.model, plant.state, 1, gaps)
        assert gaps.min() < 0.0
        assert np.array_equal(rows[XI, 1:], gaps)
        record_in_process(free, tmp_path / "a.mcap", compiled=False)
        recording = read(tmp_path / "a.mcap")
        assert recording.problems == []
        assert np.array_equal(recording.truth.arrays["xi_m"], rows[XI])
        found = verify(free, rows)
        assert found is not None
        assert found.penetration < 0.1


def test_a_scene_does_not_know_it_otherwise():
    assert list(SCHEMES) == ["modal", "thesis2008"]
    with pytest.raises(SceneError) as found:
        load("aluminium-3mm", ["run.scheme=discrete_gradient"])
    assert str(found.value) == (
        "run.scheme = 'discrete_gradient': must be 'modal' or 'thesis2008'."
    )
