"""Laws beyond the two-point threshold: windows, fading, prediction, shifts, feedback."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.controller.laws._threshold import slope
from hertzloop.controller.laws.shifted_threshold import shifted_threshold_m_s
from hertzloop.loop.answering import answer_samples
from tests.controller.drive import SLOPE, commands
from tests.controller.specs import LawSpec

STIFFNESS, MASS_KG, IMPEDANCE, SPEED = 1.1e10, 8.8e-4, 308.0, 1.0
STEP_S = 1e-6
IMPACT = LawSpec(
    "predicted",
    STIFFNESS,
    0.8,
    -0.25,
    mass_kg=MASS_KG,
    impedance_n_s_m=IMPEDANCE,
    watch_level=1e-3,
)


def gap(impedance: float = IMPEDANCE, lead_in_s: float = 20e-6, steps: int = 80) -> np.ndarray:
    """xi of sphere on infinite plate, sampled every step; contact begins after the lead-in."""

    def slope(t: float, y: np.ndarray) -> list[float]:
        p = max(-y[0], 0.0)
        force = STIFFNESS * p**1.5
        return [y[1], force / MASS_KG - 1.5 * STIFFNESS * math.sqrt(p) * y[1] / impedance]

    t = np.arange(steps) * STEP_S
    start = [SPEED * lead_in_s, -SPEED]
    return np.asarray(
        solve_ivp(slope, (0.0, t[-1]), start, t_eval=t, rtol=1e-10, atol=1e-16, max_step=1e-7).y[0]
    )


def acts(law: LawSpec, samples: np.ndarray) -> tuple[int, int, np.ndarray]:
    """First sample with a command, latched delay, commands by sample."""
    controller = Controller(law.bound(STEP_S), SignalPath(), STEP_S, len(samples) + 1, 1, 0)
    reply = answer_samples(controller, samples)
    command = controller.forces[1 : len(samples) + 1]
    return int(np.flatnonzero(command)[0]), int(reply.delays[-1]), command


@pytest.mark.parametrize("window", [3, 4, 7])
def test_the_slope_of_a_window_is_that_of_the_least_squares_line(window):
    samples = np.random.default_rng(1).standard_normal(30)
    constants = replace(SLOPE, window=window).constants(0.5)
    for index in range(window - 1, 30):
        last = samples[index + 1 - window : index + 1]
        line = np.polyfit(0.5 * np.arange(window), last, 1)
        assert slope(constants, samples, index) == pytest.approx(line[0], rel=1e-12, abs=1e-13)


def test_the_force_fades_after_the_contact():
    samples = [1.0, -1.0, -4.0, -4.0, 1.0, 1.0, 1.0, 1.0]
    full, faded = (
        commands(SLOPE, samples),
        commands(replace(SLOPE, law="fade_out", fade_samples=1), samples),
    )
    assert full[:8].tolist() == [0, 0, 0, 4, 32, 32, 0, 0]
    # One sample after the contact half of it is left, then nothing.
    assert faded[:8].tolist() == [0, 0, 0, 4, 16, 0, 0, 0]
    at_once = commands(replace(SLOPE, law="fade_out"), samples)
    assert at_once[:8].tolist() == [0, 0, 0, 4, 0, 0, 0, 0]


@pytest.mark.parametrize("lead", [1, 20])
def test_prediction_commands_now_what_is_due_later(lead):
    """The command `lead` samples early is that of a law without dead time, within 2 % of the
    peak; the two-point law without dead time latches one of the same two samples."""
    samples = gap(lead_in_s=40e-6, steps=110)
    ideal, delay_0, wanted = acts(replace(IMPACT, law="slope_threshold"), samples)
    first, delay, command = acts(replace(IMPACT, lead_samples=lead), samples)
    assert abs(delay - delay_0) <= 1
    assert abs(first + lead - ideal) <= 1
    shifted = np.roll(command, lead + delay_0 - delay)
    assert np.abs(shifted - wanted).max() < 0.02 * wanted.max()


def test_a_law_that_predicts_does_not_act_twice_on_one_contact():
    _, _, command = acts(replace(IMPACT, lead_samples=20), gap())
    on = np.flatnonzero(np.diff((command > 0.0).astype(int), prepend=0) == 1)
    assert len(on) == 1


def test_a_sphere_that_passes_by_is_left_alone():
    """Near the plate, but rising: nothing is due."""
    rising = 1e-6 * np.arange(5, 60) ** 1.0
    law = replace(IMPACT, lead_samples=10)
    controller = Controller(law.bound(STEP_S), SignalPath(), STEP_S, 60, 1, 0)
    answer_samples(controller, rising)
    assert not controller.forces.any()


def test_a_shifted_threshold_is_the_slope_that_much_earlier():
    samples = gap(impedance=1e12)
    slopes = np.diff(samples) / STEP_S
    at = int(np.flatnonzero(slopes > -0.25)[0])
    for earlier in (1, 4, 8):
        shifted = shifted_threshold_m_s(STIFFNESS, MASS_KG, 1e12, SPEED, -0.25, earlier * STEP_S)
        crossed = int(np.flatnonzero(slopes > shifted)[0])
        assert abs(at - crossed - earlier) <= 1


def test_feedback_multiplies_the_smallest_samples_too():
    law = LawSpec("force_feedback", 1.0, gain=-2.0)
    assert commands(law, [0.0, 1e-9, -0.5, 1.0, -3.0]).tolist()[:5] == [0, -2e-9, 1, -2, 6]


def test_integral_feedback_integrates_and_leaks():
    ones = [1.0] * 50
    kept = commands(LawSpec("acceleration_feedback", 1.0, gain=3.0), ones)
    assert kept[:50] == pytest.approx(3.0 * np.arange(1, 51), rel=1e-14)
    leaking = commands(LawSpec("acceleration_feedback", 1.0, gain=3.0, leak_hz=0.05), ones)
    share = math.exp(-2.0 * math.pi * 0.05)
    assert leaking[49] == pytest.approx(3.0 * share / (1.0 - share), rel=1e-6)
