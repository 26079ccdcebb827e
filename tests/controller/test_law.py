"""The force laws: mode, delay and command after every sample."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hertzloop.bus.events import MODES
from hertzloop.controller.controller import Controller, SignalPath
from tests.controller import reference
from tests.controller.drive import SLOPE, commands, drive
from tests.controller.specs import LawSpec
from tests.controller.strategies import LEVELS, PROFILES, SEQUENCES, THRESHOLDS

LETTERS = {name[0].upper(): mode for mode, name in enumerate(MODES)}  # I, W, A, S

PROFILE = LawSpec("profile", 1.0, profile_n=(0.0, 2.0, -3.0))
CONSTANT = LawSpec("constant", 1.0, profile_n=(5.0, 5.0))

# name: law, samples (one a second), modes, latched delays, commands
ROWS = {
    "one contact": (
        # Latched at the third sample in contact, then the contact again, two samples late.
        SLOPE,
        [1, -1, -4, -4, -1, 1, 1, 1, 1],
        "IWWAAAAII",
        [0, 0, 0, 2, 2, 2, 2, 2, 2],
        [0, 0, 0, 4, 32, 32, 4, 0, 0],
    ),
    "armed again for the next contact": (
        SLOPE,
        [1, -1, -1, 1, 1, -1, -4, -9, -9, 1, 1, 1, 1],
        "IWAAIWWWAAAAI",
        [0, 0, 1, 1, 1, 1, 1, 1, 3, 3, 3, 3, 3],
        [0, 0, 4, 4, 0, 0, 0, 0, 4, 32, 108, 108, 0],
    ),
    "constant force, spent until the contact ends": (
        CONSTANT,
        [1, -1, -1, -1, -1, 1, -1, -1],
        "IAASSIAA",
        [0] * 8,
        [0, 5, 5, 0, 0, 0, 5, 5],
    ),
    "off": (replace(SLOPE, law="off"), [1, -1, -4, -4, 1], "IIIII", [0] * 5, [0] * 5),
}


@pytest.mark.parametrize("name", ROWS)
def test_mode_delay_and_command_after_every_sample(name):
    law, samples, modes, delays, forces = ROWS[name]
    driven = drive(law, SignalPath(), samples)
    assert driven.modes.tolist() == [LETTERS[letter] for letter in modes]
    assert driven.delays.tolist() == delays
    assert commands(law, samples).tolist() == forces


@pytest.mark.parametrize(("step_s", "every_steps"), [(0.5, 1), (0.25, 2)])
def test_the_slope_is_per_second(step_s, every_steps):
    """Samples half a second apart: the slopes are twice the differences."""
    law = replace(SLOPE, v_thr_m_s=-3.0)
    controller = Controller(
        law.bound(every_steps * step_s), SignalPath(), step_s, 20, every_steps, 0
    )
    modes = controller.process(np.array([1.0, -1.0, -3.0, -4.0, -4.0])).modes
    assert modes.tolist() == [LETTERS[letter] for letter in "IWWAA"]


@given(SEQUENCES, THRESHOLDS, LEVELS, st.sampled_from([0.8, -0.4]))
@settings(max_examples=150, deadline=None)
def test_slope_threshold_against_plain_python(samples, v_thr, level, kappa):
    law = LawSpec("slope_threshold", 3.7, kappa, v_thr, contact_level=level)
    delays, latched = [], {}
    rows = reference.slope_threshold(samples, kappa * 3.7, v_thr, level, latched.__setitem__)
    for i in range(len(samples)):
        delays.append(latched.get(i, delays[-1] if delays else 0))
    driven = drive(law, SignalPath(), samples)
    assert driven.modes.tolist() == [mode for mode, _ in rows]
    assert driven.delays.tolist() == delays
    # p sqrt(p) and p ** 1.5 differ by a few roundings of 1.1e-16.
    np.testing.assert_allclose(
        commands(law, samples), [force for _, force in rows], rtol=1e-15, atol=0.0
    )


@given(SEQUENCES, PROFILES, LEVELS)
@settings(max_examples=100, deadline=None)
def test_profile_against_plain_python(samples, forces, level):
    law = LawSpec("profile", 1.0, profile_n=forces, contact_level=level)
    rows = reference.profile(samples, forces, level)
    assert drive(law, SignalPath(), samples).modes.tolist() == [mode for mode, _ in rows]
    assert commands(law, samples).tolist() == [force for _, force in rows]
