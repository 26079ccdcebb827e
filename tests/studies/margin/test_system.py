"""The plant as a linear system: state space, python-control and files give its response."""

import numpy as np
import pytest
import scipy.io

import hertzloop
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load

ACTUATOR = ["actuator.bandwidth_hz=20000", "sensors.low_pass_hz=50000"]
VARIANTS = {
    "v_p": ("v_p", ["run.accuracy=0.1"]),
    "acceleration": ("acceleration", ["run.accuracy=0.1"]),
    "xi": ("xi", ["run.accuracy=0.1"]),
    "actuator": ("v_p", ["run.accuracy=0.1", *ACTUATOR]),
    "decimated": ("v_p", ["run.accuracy=0.1", "sensors.every_steps=3", "controller.latency_us=7"]),
}


@pytest.fixture(scope="module", params=VARIANTS)
def system(request):
    quantity, settings = VARIANTS[request.param]
    return hertzloop.linear(load("oak-20mm", settings), quantity)


def test_the_state_space_has_the_impulse_response(system):
    expected = system.impulse_response(300)
    for latency in (False, True):
        a, b, c, d = system.to_statespace(latency)
        late = system.delay if latency else 0
        state, found = np.zeros_like(b), []
        for k in range(300):
            force = 1.0 if k == 0 else 0.0
            found.append(float((c @ state + d * force)[0, 0]))
            state = a @ state + b * force
        shifted = np.concatenate([np.zeros(late), expected])[:300]
        assert np.abs(found - shifted).max() <= 1e-12 * np.abs(expected).max()


def test_the_frequency_response_is_that_of_the_impulse_response(system):
    """At complex frequencies whose terms die out within the samples that are summed."""
    z = 1.05 * np.exp(1j * np.linspace(0.0, 3.0, 7))
    summed = system.impulse_response(800) @ z ** -np.arange(800)[:, None]
    assert np.abs(summed - system.at(z)).max() <= 1e-11 * np.abs(summed).max()
    frequency_hz = np.array([10.0, 1234.5])
    turn = np.exp(2j * np.pi * frequency_hz * system.step_s)
    bare = system.frequency_response(frequency_hz)
    assert np.allclose(bare, system.at(turn), rtol=1e-14)
    late = system.frequency_response(frequency_hz, latency=True)
    assert np.allclose(late, bare * turn ** -float(system.delay), rtol=1e-12)


def test_latency_of_a_decimated_loop_is_split():
    settings = ["sensors.every_steps=3", "controller.latency_us=7", "run.accuracy=0.1"]
    system = hertzloop.linear(load("oak-20mm", settings), "v_p")
    assert (system.delay, system.step_s) == (2, 3e-6)  # 8 steps: 2 samples and 2 steps


@pytest.mark.full
def test_python_control_has_the_same_response():
    control = pytest.importorskip("control")
    system = hertzloop.linear(load("oak-20mm", ["run.accuracy=0.1"]), "v_p")
    frequency_hz = system.resonance_grid_hz()[::7]
    theirs = control.frequency_response(system.to_control(), 2.0 * np.pi * frequency_hz)
    expected = system.frequency_response(frequency_hz)
    away = np.abs(np.ravel(theirs.frdata) - expected).max()
    assert away <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("ending", [".npz", ".mat"])
def test_files_hold_the_system(tmp_path, ending):
    system = hertzloop.linear(load("oak-20mm", ["run.accuracy=0.1"]), "v_p")
    path = tmp_path / f"plant{ending}"
    system.save(path, statespace=True)
    found = np.load(path) if ending == ".npz" else scipy.io.loadmat(path, squeeze_me=True)
    assert np.array_equal(found["poles"], system.poles)
    assert np.array_equal(found["residues"], system.residues)
    assert np.array_equal(found["fir"], system.fir)
    assert (float(found["step_s"]), int(found["delay"])) == (1e-6, 1)
    assert (str(found["quantity"]), str(found["unit"])) == ("v_p", "m/s")
    assert np.array_equal(found["response"], system.frequency_response(found["frequency_hz"]))
    assert np.array_equal(found["a"], system.to_statespace().a)


def test_a_table_holds_the_frequency_response(tmp_path):
    system = hertzloop.linear(load("oak-20mm", ["run.accuracy=0.1"]), "v_p")
    system.save(tmp_path / "plant.csv")
    rows = np.genfromtxt(tmp_path / "plant.csv", delimiter=",", names=True)
    expected = system.frequency_response(rows["frequency_hz"])
    assert np.array_equal(rows["real"] + 1j * rows["imag"], expected)
    with pytest.raises(ValueError, match=r"ends in \.npz, \.csv or \.mat"):
        system.save(tmp_path / "plant.txt")


def test_the_contact_force_has_no_response_in_flight():
    with pytest.raises(SceneError, match="no linear response in flight"):
        hertzloop.linear(load("oak-20mm"), "contact_force")
