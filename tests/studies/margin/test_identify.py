"""Whether a law is linear, and with which transfer function."""

import numpy as np
import pytest
import scipy.signal as sg

from hertzloop.controller.loading.registry import find, shipped
from hertzloop.scene.setup import load
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.identify import NotLinearError, law_filter, probe

LAW = '''"""A filter of two poles."""

senses = "v_p"


class State:
    """Two stages."""

    a: float = 0.0
    b: float = 0.0


def command(p, s, samples, i):
    """Force of sample i, N."""
    s.a = 0.9 * s.a + samples[i]
    s.b = 0.8 * s.b + 0.1 * s.a
    return FORCE
'''


def setup_with(tmp_path, force):
    path = tmp_path / "mine.py"
    path.write_text(LAW.replace("FORCE", force), encoding="utf-8")
    return load("oak-20mm", [f"controller.law={path}", "sensors.quantity=v_p"])


def test_a_linear_law_of_the_user_is_identified(tmp_path):
    found = law_filter(setup_with(tmp_path, "-20.0 * s.b"))
    z = np.exp(1j * np.linspace(0.01, 3.1, 50))
    expected = -2.0 / ((1.0 - 0.9 / z) * (1.0 - 0.8 / z))
    assert np.abs(found.at(z) - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(
    "force",
    [
        "min(max(-20.0 * s.b, -100.0), 100.0)",
        "-20.0 * s.b * (1.0 + 1e-4 * i)",
        "-20.0 * s.b + 1e-3",
        "-20.0 * s.b if abs(s.b) > 1e-6 else 0.0",
    ],
)
def test_a_law_that_is_not_linear_is_refused(tmp_path, force):
    with pytest.raises(NotLinearError):
        law_filter(setup_with(tmp_path, force))


def test_a_slow_law_is_refused_before_it_takes_minutes(tmp_path):
    path = tmp_path / "mine.py"
    slow = LAW.replace("FORCE", "-20.0 * s.b").replace(
        "    s.a = 0.9", "    sleep(2e-3)\n    s.a = 0.9"
    )
    path.write_text(slow.replace("senses =", "from time import sleep\n\nsenses ="))
    with pytest.raises(NotLinearError, match=r"it takes [\d,]+ us a sample, .* up to 1,000"):
        law_filter(load("oak-20mm", [f"controller.law={path}", "sensors.quantity=v_p"]))


@pytest.mark.parametrize(
    ("law", "quantity"), [("velocity_feedback", "v_p"), ("acceleration_feedback", "acceleration")]
)
def test_constants_of_shipped_laws_agree_with_a_probe(law, quantity):
    setup = load("oak-20mm", [f"controller.law={law}", f"sensors.quantity={quantity}"])
    setup = setup.vary({"sensors.bits": "ideal", "controller.bits": "ideal"})
    z = np.exp(1j * np.linspace(0.01, 3.1, 50))
    read, probed = law_filter(setup).at(z), probe(setup).at(z)
    assert np.abs(read - probed).max() <= 1e-9 * np.abs(read).max()


@pytest.mark.parametrize(
    "setting",
    [
        "controller.jitter_us=3",
        "controller.drop_out_probability=0.1",
        "controller.latency_trace=[0,600]",
        "actuator.stuck_from_s=0.001",
    ],
)
def test_what_the_transfer_function_does_not_hold_is_refused(setting):
    law = ["controller.law=velocity_feedback", "controller.kappa=0.1"]
    assert law_filter(load("aluminium-3mm", law)).fir[0] < 0.0
    with pytest.raises(NotLinearError, match=setting.split("=")[0]):
        law_filter(load("aluminium-3mm", [*law, setting]))


@pytest.mark.parametrize(
    "sos",
    [
        sg.butter(8, 2000.0, fs=1e6, output="sos"),
        sg.tf2sos(*sg.iirnotch(791.0, 30.0, fs=1e6)),
        [[1.0, -2.0, 1.0, 1.0, -0.5, 0.06], [0.3, 0.0, 0.0, 1.0, -0.5, 0.06]],  # double poles
    ],
    ids=["butter", "notch", "double"],
)
def test_sections_have_the_response_of_their_polynomials(sos):
    theta = np.geomspace(1e-4, 3.1, 200)
    exact = np.exp(1j * theta.astype(np.longdouble))  # near z = 1 a double has too few digits
    rows = np.asarray(sos, np.longdouble)
    expected = np.asarray(
        -20.0
        * np.prod(
            [np.polyval(row[:3], exact) / np.polyval(row[3:], exact) for row in rows], axis=0
        ),
        complex,
    )
    setup = load(
        "oak-20mm",
        [
            "controller.law=linear",
            "controller.gain=-20",
            f"controller.sections={np.asarray(sos).tolist()}",
        ],
    )
    found = law_filter(setup)
    z = np.asarray(exact, complex)
    assert np.abs(found.at(z) - expected).max() <= 1e-11 * np.abs(expected).max()


@pytest.mark.full
def test_an_integrator_counts_as_a_slow_decay():
    keys = ["controller.numerator=[-1e-4]", "controller.denominator=[1, -1]"]
    found = margin_of(
        load(
            "oak-20mm",
            ["controller.law=linear", *keys, "sensors.quantity=acceleration", "run.accuracy=0.1"],
        )
    )
    assert found.applicable
    assert found.stable


@pytest.mark.filterwarnings("error")
def test_a_zero_on_the_circle_is_met_without_a_warning():
    keys = ["controller.numerator=[1.0, -1.0]", "controller.denominator=[1.0, -0.5]"]
    law = law_filter(load("oak-20mm", ["controller.law=linear", *keys]))
    assert law.at(np.array([1.0 + 0j]))[0] == 0.0


LINEAR = {"velocity_feedback", "acceleration_feedback", "force_feedback", "linear"}


def test_a_shipped_law_says_whether_it_is_linear():
    for name in shipped():
        law = find(name)
        assert bool(law.not_linear) == (name not in LINEAR)
        assert not law.not_linear or law.not_linear.startswith("it")
