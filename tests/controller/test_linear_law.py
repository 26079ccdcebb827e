"""The law `linear`: its samples, its files, and what it refuses."""

from typing import Any

import numpy as np
import pytest
import scipy.signal as sg

from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.loop.answering import answer_samples
from hertzloop.scene.controller import bound_law, loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from hertzloop.scene.toml import to_toml

FS = 1e6


def setup_of(*keys: str) -> Setup:
    return load("aluminium-3mm", ["controller.law=linear", *(f"controller.{k}" for k in keys)])


def forces(setup: Setup, samples: np.ndarray) -> np.ndarray:
    count = len(samples)
    controller = Controller(
        bound_law(setup, False), SignalPath(), setup.run.step_s, count + 2, 1, 0
    )
    return np.asarray(answer_samples(controller, samples, commands_ahead=False).forces)[-count:]


SECTIONS = {
    "butter": sg.butter(8, 2000.0, fs=FS, output="sos"),
    "cheby2": sg.cheby2(4, 60.0, [500.0, 5e3], "bandpass", fs=FS, output="sos"),
}


@pytest.mark.parametrize("name", SECTIONS)
def test_sections_give_the_samples_of_sosfilt(name):
    samples = np.random.default_rng(4).standard_normal(20_000)
    expected = -3.0 * sg.sosfilt(SECTIONS[name], samples)
    found = forces(setup_of("gain=-3", f"sections={SECTIONS[name].tolist()}"), samples)
    assert np.abs(found - expected).max() <= 3e-12 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("b", "a"),
    [
        (sg.firwin(101, 0.2), np.ones(1)),
        sg.cheby1(5, 1.0, 0.4),
        (np.array([0.0, 0.0, 3.0]), np.array([2.0, -1.0])),
    ],
    ids=["fir", "cheby1", "delay"],
)
def test_polynomials_give_the_samples_of_lfilter(b, a):
    samples = np.random.default_rng(5).standard_normal(5000)
    expected = sg.lfilter(b, a, samples)
    keys = [f"numerator={b.tolist()}", f"denominator={a.tolist()}"]
    found = forces(setup_of(*keys), samples)
    assert np.abs(found - expected).max() <= 3e-12 * np.abs(expected).max()


def state_space() -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """A late filter as a state space of some other coordinates, with its polynomials in 1/z."""
    b, a = sg.butter(3, 0.2)
    b, a = np.concatenate([[0.0, 0.0], b]), np.concatenate([a, [0.0, 0.0]])
    A, B, C, D = sg.tf2ss(np.trim_zeros(b, "f"), a)
    turn = np.random.default_rng(7).standard_normal(A.shape)
    turned = {"A": np.linalg.solve(turn, A @ turn), "B": np.linalg.solve(turn, B)}
    return turned | {"C": C @ turn, "D": D}, b, a


def test_a_file_is_read(tmp_path):
    sos = sg.butter(3, 0.05, output="sos")
    b, a = sg.sos2tf(sos)
    late = sg.TransferFunction([2.0], [1.0, -0.5, 0.2], dt=1e-6)  # 2/(z^2 - 0.5 z + 0.2)
    cases: list[tuple[dict[str, Any], Any, Any]] = [
        ({"sos": sos}, b, a),
        ({"b": b, "a": a, "dt": 1e-6}, b, a),
        ({"num": [[late.num]], "den": [[late.den]], "dt": 1e-6}, [0.0, 0.0, 2.0], late.den),
        state_space(),
        ({"A": [[0.5]], "B": [[0.0]], "C": [[1.0]], "D": [[0.0]]}, [0.0], [1.0]),
    ]
    path, scene = tmp_path / "filter.npz", tmp_path / "mine.toml"
    text = to_toml(setup_of("numerator=[1.0]").scene)
    scene.write_text(text.replace('filter_file = ""', f'filter_file = "{path.name}"'))
    samples = np.random.default_rng(6).standard_normal(2000)
    for arrays, b, a in cases:
        np.savez(path, **arrays)
        expected = sg.lfilter(b, a, samples)
        close = 1e-9 if "A" in arrays else 3e-12
        for setup in (
            setup_of(f"filter_file={path}"),
            load(str(scene)).vary({"controller.gain": 1}),
        ):
            assert np.abs(forces(setup, samples) - expected).max() <= close * np.abs(expected).max()
            keys = setup.scene.controller.keys
            assert keys.filter_file == ""  # a recording needs no file
            assert keys.designed_us == pytest.approx(1.0 if "dt" in arrays else 0.0)


@pytest.mark.parametrize("dt", [True, None, -1])
def test_a_sampling_interval_that_is_unknown(tmp_path, dt):
    np.savez(tmp_path / "filter.npz", b=[1.0 + 0.0j, 0.5], a=[1.0], dt=dt)
    keys: Any = setup_of(f"filter_file={tmp_path / 'filter.npz'}").scene.controller.keys
    assert (keys.numerator, keys.designed_us) == ((1.0, 0.5), 0.0)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"x": [1.0]}, "holds no filter. Save the array sos, or b and a, or num and den, or A, B"),
        ({"sos": [[1.0, 2.0, 3.0]]}, "'sos' has shape (1, 3)"),
        ({"b": [np.nan], "a": [1.0]}, "'b' holds numbers that are not finite"),
        ({"num": [1.0, 2.0, 3.0], "den": [1.0, 0.5]}, "'num' has 3 coefficients and 'den' 2"),
        ({"b": [1.0], "a": [1.0], "dt": 2e-6}, "controller.designed_us = 2"),
        ({"b": [1.0 + 0.5j], "a": [1.0]}, "'b' has complex numbers"),
        (
            {"A": np.eye(2), "B": np.eye(2), "C": np.eye(2), "D": np.eye(2)},
            "(n, n), (n, 1), (1, n)",
        ),
        (
            dict(zip("ABCD", sg.tf2ss([1.0], np.poly([0.99] * 12)), strict=True)),
            "too ill-conditioned to run as a filter. Save sections",
        ),
        ({"num": [-40.0, 0.0], "den": [1.0, 1e5], "dt": 0}, "dt = 0 marks a continuous filter"),
        ({"b": [1.0, 2.0], "a": [1.0], "num": [1.0], "den": [1.0, 0.5]}, "more than one filter"),
        ({"b": [1.0], "a": np.array([{}])}, "Object arrays cannot be loaded"),
    ],
)
def test_a_file_without_a_filter_is_refused(tmp_path, arrays, words):
    np.savez(tmp_path / "filter.npz", **arrays)
    with pytest.raises(SceneError) as error:
        bound_law(setup_of(f"filter_file={tmp_path / 'filter.npz'}"))
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ([], "controller.numerator is empty"),
        (["numerator=[1]", "denominator=[0, 1]"], "the first coefficient must not be zero"),
        (["numerator=[nan]"], "controller.numerator = nan: is not possible"),
        (["sections=[[1, 2, 3]]"], "section 0 has 3 numbers. Give six"),
        (["sections=[[1, 0, 0, 1, 0, 0], [1, 0, 0, 0, 0, 0]]"], "a0 of section 1 is zero"),
        (["numerator=[1]", "sections=[[1, 0, 0, 1, 0, 0]]"], "cannot stand beside"),
        ([f"numerator={[1.0] * 300}"], "needs 299 stored numbers; the limit is 256"),
        (["filter_file=none.npz"], "cannot be read: there is no such file"),
        (["filter_file=none.csv"], "ends in .npz"),
    ],
)
def test_what_is_no_filter_is_refused(keys, words):
    with pytest.raises(SceneError) as error:
        setup_of(*keys)
    assert words in str(error.value)


def test_a_filter_that_is_unstable_by_itself_is_noted():
    unstable = setup_of("numerator=[1.0]", "denominator=[1.0, -1.5]")
    assert "poles outside the unit circle: 1; largest magnitude 1.5" in loaded_law(unstable).note(
        unstable.scene.controller.keys
    )
    for keys in (["denominator=[1.0, -1.0]"], ["denominator=[1.0, -0.9]"]):
        setup = setup_of("numerator=[1.0]", *keys)
        assert loaded_law(setup).note(setup.scene.controller.keys) == ""
