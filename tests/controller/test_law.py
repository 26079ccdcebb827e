"""The force laws: mode, delay and command after every sample."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hertzloop.bus.events import MODES
from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.loop.answering import answer_samples
from tests.controller.drive import SLOPE, commands, drive
from tests.controller.specs import LawSpec
from tests.controller.strategies import LEVELS, SEQUENCES, THRESHOLDS

LETTERS = {name[0].upper(): mode for mode, name in enumerate(MODES)}  # I, W, A, S

PROFILE = LawSpec("profile", 1.0, profile_n=(0.0, 2.0, -3.0))
CONSTANT = LawSpec("constant", 1.0, profile_n=(5.0, 5.0))

# name: law, samples (one a second), modes, latched delays, commands
ROWS = {
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
    modes = answer_samples(controller, np.array([1.0, -1.0, -3.0, -4.0, -4.0])).modes
    assert modes.tolist() == [LETTERS[letter] for letter in "IWWAA"]


IDLE, WATCHING, ACTING, SPENT = range(4)

Row = tuple[int, float]  # mode after a sample, its command


def _start_of_contact(touching: Sequence[bool], i: int) -> int:
    while i > 0 and touching[i - 1]:
        i -= 1
    return i


def by_plain_python(
    samples: Sequence[float],
    factor: float,
    v_thr: float,
    level: float = 0.0,
    on_latch: Callable[[int, int], None] = lambda at, delay: None,
) -> list[Row]:
    """Modes and commands of the law as the sentences that define it tell a run, contact by contact:
    one sample a second, `factor` = kappa s."""
    n = len(samples)
    touching = [x <= level for x in samples]
    rows: list[Row] = []

    def rises(i: int) -> bool:
        return i > 0 and samples[i] - samples[i - 1] > v_thr

    while len(rows) < n:
        i = len(rows)
        if not touching[i]:
            rows.append((IDLE, 0.0))
            continue
        while i < n and touching[i] and not rises(i):
            rows.append((WATCHING, 0.0))
            i += 1
        if i == n or not touching[i]:
            continue
        delay = i - _start_of_contact(touching, i)
        on_latch(i, delay)
        while i < n and touching[i - delay]:
            rows.append((ACTING, factor * max(0.0, -samples[i - delay]) ** 1.5))
            i += 1
        if i < n:  # the sample at which the stored contact is over is not judged again
            rows.append((WATCHING if touching[i] else IDLE, 0.0))
    return rows


@given(SEQUENCES, THRESHOLDS, LEVELS, st.sampled_from([0.8, -0.4]))
@settings(max_examples=150, deadline=None)
def test_slope_threshold_against_plain_python(samples, v_thr, level, kappa):
    law = LawSpec("slope_threshold", 3.7, kappa, v_thr, contact_level=level)
    delays, latched = [], {}
    rows = by_plain_python(samples, kappa * 3.7, v_thr, level, latched.__setitem__)
    for i in range(len(samples)):
        delays.append(latched.get(i, delays[-1] if delays else 0))
    driven = drive(law, SignalPath(), samples)
    assert driven.modes.tolist() == [mode for mode, _ in rows]
    assert driven.delays.tolist() == delays
    # p sqrt(p) and p ** 1.5 differ by a few roundings of 1.1e-16.
    np.testing.assert_allclose(
        commands(law, samples), [force for _, force in rows], rtol=1e-15, atol=0.0
    )
