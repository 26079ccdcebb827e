"""The chart's further schemes: compiled DOP853, quadratised potential, direct convolution."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks import dop853_kernels
from benchmarks import integrator_kernels as ik
from benchmarks import integrators as cases


@pytest.fixture(scope="module")
def small() -> cases.Problem:
    what = cases.problem("aluminium-3mm", 6e-5)
    keep = np.sqrt(what.omega2) < 2 * np.pi * 30e3
    return cases.Problem(what.name, what.spec, what.duration_s, what.omega2[keep], what.drive[keep])


def orders(run: Callable[[float], np.ndarray], steps: tuple[float, ...]) -> np.ndarray:
    """Observed orders between successive steps that halve, by differences of the results."""
    found = [run(h) for h in steps]
    apart = [np.abs(a - b).max() for a, b in pairwise(found)]
    return np.log2(np.divide(apart[:-1], apart[1:]))


# --- DOP853


def smooth() -> tuple[np.ndarray, tuple]:
    """A sphere resting deep in the contact: it vibrates and never leaves."""
    omega2, drive = np.array([1e4, 4e4, 9e4]), np.array([2.0, 1.0, 0.5])
    y = np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.1, -0.05, 0.0])
    return y, (omega2, drive, 1e3, 1.0)


@pytest.mark.full
def test_dop853_has_order_8() -> None:
    def run(h: float) -> np.ndarray:
        y, arguments = smooth()
        dop853_kernels.dop853(y, *arguments, 0.032, np.empty(1), 1.0, 1.0, h, True)
        return y

    found = orders(run, (2e-3, 1e-3, 5e-4, 2.5e-4))  # below, rounding
    assert 7.0 < found[0] < found[1]
    assert found[1] == pytest.approx(8.0, abs=0.4)


@pytest.mark.full
def test_dop853_dense_output_has_order_7() -> None:
    def run(h: float) -> np.ndarray:
        y, arguments = smooth()
        gaps = np.empty(13)
        dop853_kernels.dop853(y, *arguments, 0.032 / 13, gaps, 1.0, 1.0, h, True)
        return gaps

    assert np.all(orders(run, (4e-3, 2e-3, 1e-3)) > 6.5)


@pytest.mark.full
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
def test_dop853_is_scipys_step_for_step(small: cases.Problem, tolerance: float) -> None:
    t = cases.SAMPLE_S * np.arange(1, small.samples + 1)
    expected = solve_ivp(
        lambda t, y: ik.slope(t, y, *small.arguments),
        (0.0, t[-1]),
        small.start(),
        method="DOP853",
        t_eval=t,
        rtol=tolerance,
        atol=1e-6 * tolerance,
        first_step=1e-6,
    )
    state, gaps = small.start(), np.empty(small.samples)
    taken, refused, evaluations = dop853_kernels.dop853(
        state, *small.arguments, cases.SAMPLE_S, gaps, tolerance, 1e-6 * tolerance, 1e-6, False
    )
    assert taken >= 10
    assert evaluations == expected.nfev
    assert evaluations > 12 * (taken + refused)
    modes = len(small.omega2)
    gap = expected.y[2 * modes] - expected.y[:modes].sum(axis=0)
    np.testing.assert_allclose(gaps, gap, rtol=0, atol=1e-9 * np.abs(gap).max())
    np.testing.assert_allclose(state, expected.y[:, -1], rtol=0, atol=1e-8)


@pytest.mark.full
def test_dop853_says_that_a_step_vanishes() -> None:
    y, arguments = smooth()
    y[0] = math.nan
    assert dop853_kernels.dop853(y, *arguments, 1.0, np.empty(1), 1e-6, 1e-9, 1e-3, False) == (
        -1,
        -1,
        -1,
    )


def test_slow_solver_is_cut_off(small: cases.Problem) -> None:
    with pytest.raises(cases.TooSlowError, match=r"stopped after 0.01 s of CPU time, \d+% of the"):
        cases.scipy_run("Radau", small, 1e-8, [0], 0.01)()


def test_jacobian_is_the_slopes(small: cases.Problem) -> None:
    rng = np.random.default_rng(1)
    y = rng.normal(size=2 * len(small.omega2) + 2) * 1e-6
    y[-2] = y[: len(small.omega2)].sum() - 1e-5  # in contact
    matrix = ik.jacobian(y, *small.arguments)
    for i in rng.choice(len(y), 10):
        step = np.zeros_like(y)
        step[i] = 1e-9
        up, down = (
            ik.slope(0.0, y + step, *small.arguments),
            ik.slope(0.0, y - step, *small.arguments),
        )
        np.testing.assert_allclose((up - down) / 2e-9, matrix[:, i], rtol=1e-5, atol=1e-2)


# --- collocation at Gauss nodes


def collocation_errors(
    small: cases.Problem, stages: int, steps: tuple[float, ...], levels: int | None, height_m: float
) -> np.ndarray:
    """Largest errors of the gap, relative, over a contact with its touch and its end."""
    state, exact = small.start(), np.empty(small.samples)
    state[-2] = height_m
    dop853_kernels.dop853(state, *small.arguments, cases.SAMPLE_S, exact, 1e-13, 1e-19, 1e-6, False)
    assert exact[1] < 0.0 < exact[10]
    runs = [cases.collocation_run(small, h, stages, levels, height_m) for h in steps]
    return np.array([np.abs(run()[0] - exact).max() for run in runs]) / -exact.min()


@pytest.mark.full
@pytest.mark.parametrize(
    ("stages", "steps", "order"),
    [
        (1, (1e-6, 5e-7, 2.5e-7, 1.25e-7), 2),
        (2, (1e-6, 5e-7, 2.5e-7, 1.25e-7), 4),
        (3, (4e-6, 2e-6, 1e-6), 6),  # below, rounding of the reference
    ],
)
@pytest.mark.parametrize("height_m", [0.0, 1.3e-6])
def test_graded_collocation_has_its_order_over_a_contact(
    small: cases.Problem, stages: int, steps: tuple[float, ...], order: int, height_m: float
) -> None:
    errors = collocation_errors(small, stages, steps, None, height_m)
    mean = math.log2(errors[0] / errors[-1]) / (len(errors) - 1)
    assert mean > order - 0.3
    assert errors[-1] < 1e-5


@pytest.mark.full
def test_equal_steps_lose_the_order_at_touch_and_end(small: cases.Problem) -> None:
    steps = (4e-6, 2e-6, 1e-6, 5e-7, 2.5e-7, 1.25e-7)
    errors = collocation_errors(small, 3, steps, 1, 0.0)
    mean = math.log2(errors[0] / errors[-1]) / (len(errors) - 1)
    assert 1.5 < mean < 3.5


# --- quadratised potential


def quadratised(
    h: float, steps: int, body: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gaps, body and z after some steps of the smooth problem's plate; body is copied."""
    omega2, drive, stiffness, mass = smooth()[1]
    omega = np.sqrt(omega2)
    turn = np.exp(1j * omega * h)
    change = drive / omega2 * (turn - 1.0) / 1j
    table = np.ascontiguousarray([turn.real, turn.imag, change.real, change.imag])
    gain = change.imag.sum() + 0.5 * h * h / mass
    z, body, gaps = np.zeros((2, 3)), body.copy(), np.empty(steps)
    ik.quadratised(z, body, table, gain, stiffness, mass, h, 1, gaps)
    return gaps, body, np.concatenate([z[1], omega * z[0]])


def root(gap: float, stiffness: float = 1e3) -> float:
    return math.sqrt(0.8 * stiffness * (-gap) ** 2.5)


def test_quadratised_has_order_2_within_a_contact() -> None:
    start = np.array([-0.05, 0.1, -0.05, root(-0.05)])

    def run(h: float) -> np.ndarray:
        gaps, body, _ = quadratised(h, round(0.064 / h), start)
        assert gaps.max() < 0.0  # it stays in contact
        return body

    found = orders(run, (4e-4, 2e-4, 1e-4, 5e-5))
    assert np.all(np.abs(found - 2.0) < 0.15)


def test_quadratised_keeps_the_pseudo_energy_while_psi_drifts() -> None:
    """From the touch on: psi^2/2 balances to rounding, and is not the energy in the contact."""
    omega2, drive, stiffness, mass = smooth()[1]
    for h in (1e-3, 1e-2):
        gaps, body, modes = quadratised(h, 200, np.array([0.0, -0.5, 0.0, 0.0]))
        assert gaps.min() < -1e-3
        y = np.concatenate([modes, body[:2]])
        deep = 0.4 * stiffness * max(-body[2], 0.0) ** 2.5
        pseudo = ik.energy(y, omega2, drive, stiffness, mass) - deep + 0.5 * body[3] ** 2
        assert pseudo == pytest.approx(0.125, rel=1e-12)
    drifts = []
    for h in (4e-4, 2e-4, 1e-4):
        gaps, body, _ = quadratised(h, round(0.02 / h), np.array([0.0, -0.5, 0.0, 0.0]))
        drifts.append(abs(body[3] - root(gaps[-1])) / root(gaps[-1]))
    assert drifts[0] > 1e-4
    # The touch costs it its order: psi ~ p^1.25 has no second derivative there.
    assert np.all(np.abs(np.log2(np.divide(drifts[:-1], drifts[1:])) - 1.25) < 0.3)


# --- direct convolution


@pytest.mark.full
def test_convolution_has_order_2(small: cases.Problem) -> None:
    exact = cases.dop853_run(small, 1e-10)()[0]
    errors = [
        np.abs(cases.convolution_run(small, h)()[0] - exact).max() for h in (1e-6, 5e-7, 2.5e-7)
    ]
    assert np.all(np.abs(np.log2(np.divide(errors[:-1], errors[1:])) - 2.0) < 0.3)


def test_convolution_ends_in_the_state_of_its_forces(small: cases.Problem) -> None:
    """The energy of the state converges to that of the start: gap and state belong together."""
    drifts = [abs(cases.convolution_run(small, h)()[1]) for h in (1e-6, 2.5e-7)]
    assert drifts[1] < 1e-4
    assert drifts[1] < drifts[0] / 8
