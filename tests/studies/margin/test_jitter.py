"""The jitter margin: closed forms, an independent response, a search, and verdicts on scenes."""

import math

import numpy as np
import pytest

from benchmarks.jitter_margin import (
    RandomLoop,
    Search,
    random_loop,
)
from benchmarks.margin import simulated_growth_per_s
from hertzloop.scene.setup import load
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.jitter import (
    ErrorResponse,
    JitterMargin,
    at_shortest_latency,
    jitter_margin_of,
)
from hertzloop.studies.margin.linear import TransferFunction
from hertzloop.studies.margin.loop import PolyphaseLoop
from tests.commands import as_options, succeed
from tests.hertzloop.scenes import json_in
from tests.tiers import default

SCENE = [
    "controller.law=velocity_feedback",
    "sensors.quantity=v_p",
    "sensors.low_pass_hz=1000",
    "controller.kappa=0.05",
]
FLIGHT = {"run.lead_in_s": 1.0, "run.duration_s": 1.01, "sphere.drop_height_m": 20.0}


def found_in(*settings: str) -> JitterMargin:
    setup = load("aluminium-20mm", [*SCENE, *settings])
    found = jitter_margin_of(setup, margin_of(at_shortest_latency(setup)))
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("loss", "angle", "gain"), [(0.05, 0.3, 0.02), (0.01, 0.05, 3e-3), (1e-4, 0.01, 1e-3)]
)
def test_an_oscillator_with_velocity_feedback_has_its_closed_form(loss, angle, gain):
    """P = (z - 1)/((z - p)(z - p*)), so that L/(1 + L) = gain (z - 1)/(z^2 - a z + b).

    With t = 1/(1 - cos theta) the square of |1 + L|/(|L| |z - 1|) is quadratic in t.
    """
    p = np.exp((-loss + 1j) * angle)
    plant = TransferFunction.of_modes(
        np.array([p]), np.array([(p - 1.0) / (p - p.conjugate())]), np.zeros(3)
    )
    law = TransferFunction.of_taps(-gain)
    delay, at = ErrorResponse(PolyphaseLoop.of(plant, law), 0).largest_delay()
    a, b = 2.0 * p.real - gain, abs(p) ** 2 - gain
    square, linear, constant = (1.0 + b - a) ** 2, 2.0 * a * (1.0 + b) - 8.0 * b, 4.0 * b
    least = math.sqrt(constant - linear**2 / (4.0 * square)) / (2.0 * gain)
    assert delay == pytest.approx(least, rel=1e-9)
    assert at == pytest.approx(math.acos(1.0 + 2.0 * square / linear), rel=1e-6)


@pytest.mark.parametrize("pole", [0.9, 0.5])
def test_a_real_pole_is_limited_at_the_nyquist_frequency(pole):
    plant = TransferFunction.of_modes(np.array([pole + 0j]), np.array([0.5 + 0j]), np.zeros(3))
    delay, at = ErrorResponse(
        PolyphaseLoop.of(plant, TransferFunction.of_taps(-0.1)), 0
    ).largest_delay()
    assert delay == pytest.approx((1.0 + pole - 0.1) / 0.2, rel=1e-12)
    assert at == pytest.approx(math.pi, abs=1e-6)


@pytest.mark.parametrize(("every", "delay"), [(1, 0), (2, 1), (3, 5), (4, 2)])
def test_the_condition_agrees_with_impulses_in_every_step(every, delay):
    """An error of the force in one step of the closed loop changes the commands as the response
    says."""
    plant = TransferFunction.of_modes(
        np.exp([-0.02 + 0.3j, -0.05 + 1.9j]),
        np.array([0.05 + 0.01j, -0.02j]),
        np.array([0.0, 0.1, 0.05]),
    )
    law = TransferFunction(np.array([0.6 + 0j]), np.array([-0.1 + 0j]), np.array([-0.3]))
    samples = 1500
    step = np.arange(samples * every)
    response = np.zeros(len(step))
    for pole, residue in zip(plant.poles, plant.residues, strict=True):
        response[1:] += (residue * pole ** step[:-1]).real
    response[:3] += plant.fir
    theta = np.pi * np.arange(1, samples + 1) / samples
    squares = []
    for r in range(every):
        error = np.zeros(len(step))
        error[delay + r] = 1.0
        force, kept, commands = error.copy(), 0.0, []
        for k in step:
            if k % every == 0:
                value = float(response[k::-1] @ force[: k + 1])
                commands.append(law.fir[0] * value + kept)
                kept = 0.6 * kept - 0.1 * value
                first = k + delay
                force[first : first + every] += commands[-1]
        changes = np.diff(commands, prepend=0.0)
        assert abs(changes[-100:]).max() < 1e-9 * abs(changes).max()
        squares.append(np.abs(np.fft.rfft(changes, 2 * samples)[1:]) ** 2)
    found = ErrorResponse(PolyphaseLoop.of(plant, law, every), delay)
    np.testing.assert_allclose(np.exp(found.at(theta)[0]), squares, rtol=1e-6, atol=1e-9)
    margin = found.largest_delay()[0]
    for whole, holds in ((math.floor(margin), True), (math.floor(margin) + 1, False)):
        missing = np.maximum(0, -(-(whole - np.arange(every)) // every))
        assert bool(whole * (missing @ np.array(squares)).max() < 1.0) is holds


def checked(loop: RandomLoop, seed: int) -> tuple[float, str, bool]:
    """Return margin, kind of an unstable sequence within it, and whether all constant latencies
    within it are stable."""
    margin, angle = ErrorResponse(loop.loops, loop.delay).largest_delay()
    within = min(math.floor(margin), 600)
    constant = loop.loops.unstable(loop.delay + np.arange(within + 1))
    return margin, Search(loop, angle, seed).unstable(within), not constant.any()


@pytest.mark.full
def test_no_sequence_within_the_margin_of_a_random_loop_is_unstable():
    for i in range(8):
        margin, kind, constant = checked(random_loop(np.random.default_rng([7, i])), i)
        assert margin > 1.0
        assert (kind, constant) == ("", True), i


def test_the_margin_of_a_scene_is_within_the_constant_limit():
    setup = load("aluminium-20mm", SCENE)
    margin, found = margin_of(setup), found_in()
    assert found.margin_steps == margin.latency_limit_steps == 7
    assert 7.0 < found.margin_us <= margin.latency_limit_us
    assert found.frequency_hz == pytest.approx(margin.binding_frequency_hz, rel=1e-4)
    assert (found.verdict, found.added_us, found.burst) == (None, 0.0, 7)


@pytest.mark.parametrize(
    ("setting", "verdict"),
    [
        ("controller.jitter_us=7", "certified"),
        ("controller.jitter_us=8", "refuted"),
        ("controller.latency_trace=[1,8]", "refuted"),
        ("controller.clock_ppm=-20", "certified"),
        ("controller.drop_out_probability=0.01", "undecided"),
        ("controller.latency_us=8", None),
    ],
)
def test_verdicts_on_scenes(setting, verdict):
    found = found_in(setting)
    assert found.verdict == verdict
    expected = pytest.approx(8.0) if verdict == "refuted" else None
    assert found.refuted_at_us == expected


def test_latencies_between_margin_and_limit_are_undecided():
    setup = load("oak-20mm", [*SCENE[:2], "controller.kappa=0.4", "controller.jitter_us=20"])
    found = jitter_margin_of(setup, margin_of(at_shortest_latency(setup)))
    assert found is not None
    assert (found.verdict, found.margin_steps, found.burst) == ("undecided", 0, -1)


@pytest.mark.full
def test_a_clock_that_drifts_adds_a_sampling_period():
    settings = ("sensors.every_steps=3", "controller.clock_ppm=-20", "controller.clock_phase=0.4")
    found, constant = found_in(*settings), found_in(settings[0])
    assert found.added_us == pytest.approx(3.0)
    assert found.margin_steps == constant.margin_steps
    assert constant.burst is not None
    assert found.burst == constant.burst - 1


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("controller.jitter_us=5", "certified, 5 us above the shortest one at most"),
        ("controller.drop_out_probability=0.1", "bursts of up to 7 commands in a row certified"),
        ("controller.latency_us=10", "unstable in flight at 10 us: grows"),
    ],
)
def test_the_command_tells_margin_and_verdict(setting, said, tmp_path):
    words = [*as_options([*SCENE, setting]), "--json", tmp_path / "m.json"]
    told = succeed("margin", "aluminium-20mm", *words)
    assert said in told
    jitter = json_in(tmp_path / "m.json")["jitter"]
    if "latency" in setting:
        assert jitter["margin_steps"] == -1
        assert "jitter margin" not in told
    else:
        assert jitter["margin_steps"] == 7
        assert "sufficient, not necessary" in told


@pytest.mark.full
@pytest.mark.parametrize("jitter_us", default([7, 60], quick=[7]))
def test_the_compiled_loop_decays_within_the_margin(jitter_us):
    setup = load("aluminium-20mm", [*SCENE, f"controller.jitter_us={jitter_us}"]).vary(FLIGHT)
    grows = simulated_growth_per_s(setup, -20.0 if jitter_us == 7 else 20.0)
    assert (grows > 0.0) == (jitter_us > 7)
