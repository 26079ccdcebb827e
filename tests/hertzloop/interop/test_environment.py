"""Impacts as a vector environment: the bytes of runs with the same law, many at a time."""

import warnings

import numpy as np
import pytest

import hertzloop
from hertzloop.loop.simulate import simulate
from hertzloop.plant.time_series import F_A
from hertzloop.scene.errors import SceneError
from tests.hertzloop.interop.plant_in_c import SHORT
from tests.hertzloop.own_laws import needs_cc
from tests.hertzloop.scenes import aluminium_3mm

gymnasium = pytest.importorskip("gymnasium")

from hertzloop.interop.environment import Impacts  # noqa: E402

pytestmark = [needs_cc, pytest.mark.full]
# A gain by a power of two, so that scaling a sample and a force costs no bit.
LAW = """
def command(p, s, samples, i):
    return 64.0 * min(max(-samples[i] * 131072.0, 0.0), 1.0)
"""


@pytest.mark.parametrize("latency_us", [0, 3])
def test_it_is_the_run_with_the_same_law(tmp_path, latency_us):
    (tmp_path / "mine.py").write_text(LAW)
    scene = aluminium_3mm(
        *SHORT, f"controller.law={tmp_path / 'mine.py'}", f"controller.latency_us={latency_us}"
    )
    loop = simulate(scene)
    impacts = Impacts(scene, 3, limit_n=64.0, scale=2.0**-17)
    seen, _ = impacts.reset(seed=4)
    begin = int(impacts.batch.values["step"][0])
    gaps, forces, over = [], [], np.zeros(3, bool)
    while not over.any():
        gaps.append(impacts.batch.values["sample"].copy())
        seen, reward, over, truncated, _ = impacts.step(np.clip(-seen[:, :1], 0.0, 1.0))
        forces.append(impacts.batch.values["actuator_force_n"].copy())
        assert not truncated.any()
    steps = slice(begin, begin + len(gaps))
    for gap, force in zip(np.transpose(gaps), np.transpose(forces), strict=True):
        assert gap.tobytes() == loop.values[steps].tobytes()
        assert force.tobytes() == loop.truth[F_A, steps].tobytes()
        assert len(gap) - np.flatnonzero(gap <= 0.0)[-1] == 21  # it ends 20 steps after the contact
    assert np.max(forces) > 10.0
    assert over.all()
    assert (reward < -0.01).all()
    assert (reward > -1.5).all()
    impacts.close()


def test_what_is_over_begins_anew():
    impacts = Impacts(aluminium_3mm(*SHORT, "run.touch_phase=random"), 4)
    seen, _ = impacts.reset(seed=7)
    assert impacts.observation_space.contains(seen)
    assert len(set(seen[:, 0])) == 4
    ended = 0
    for _ in range(200):
        seen, reward, terminated, _, _ = impacts.step(np.zeros((4, 1)))
        assert ((reward < 0.0) == terminated).all()
        ended += int(terminated.sum())
    assert ended >= 8  # each of them twice
    impacts.close()


def test_nan_ends_its_own_impact_only():
    impacts, others = Impacts(aluminium_3mm(*SHORT), 3), Impacts(aluminium_3mm(*SHORT), 3)
    with pytest.raises(gymnasium.error.ResetNeeded, match="Call reset first"):
        impacts.step(np.zeros((3, 1)))
    for one in (impacts, others):
        one.reset(seed=3)
    for k in range(20):
        actions = np.array([[0.1], [np.nan if k == 5 else 0.1], [np.inf]])
        found = impacts.step(actions)
        expected = others.step(np.nan_to_num(actions, nan=0.1, posinf=1.0))
        assert found[0][::2].tobytes() == expected[0][::2].tobytes()
        if k == 5:
            assert (found[1][1], found[2][1]) == (-1.0, True)
        assert found[4]["invalid_action"].tolist() == [False, k == 5, False]
    for one in (impacts, others):
        one.close()


def test_one_impact_passes_the_check_of_gymnasium():
    from gymnasium.utils.env_checker import check_env

    one, batch = hertzloop.ImpactEnv("aluminium-3mm"), Impacts("aluminium-3mm", 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bounds without end, and of no way to draw it
        check_env(one)
    one.reset(seed=1)
    batch.reset(seed=1)
    action = np.array([0.25], np.float32)
    for _ in range(200):
        found, expected = one.step(action), batch.step(action)
        assert found[0].tobytes() == expected[0][0].astype(np.float32).tobytes()
        assert found[1:4] == (expected[1][0], expected[2][0], expected[3][0])
        if found[2]:
            break
    assert found[2]
    with pytest.raises(gymnasium.error.ResetNeeded):
        one.step(action)
    one.reset()
    assert one.step(np.array([np.nan]))[1:] == (-1.0, True, False, {"invalid_action": True})
    one.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        one.reset()


def test_another_quantity_needs_a_scale():
    scene = aluminium_3mm(*SHORT, "sensors.quantity=v_p", "controller.law=velocity_feedback")
    with pytest.raises(SceneError, match=r"sensors\.quantity = 'v_p' needs a scale"):
        Impacts(scene, 1)


def test_seeds_are_heeded_and_a_closed_one_is_refused():
    impacts = Impacts(aluminium_3mm(*SHORT, "run.touch_phase=random"), 2)

    def began(seed: object) -> np.ndarray:
        return impacts.reset(seed=seed)[0].copy()  # type: ignore[arg-type]

    assert began(5).tobytes() == began(np.int64(5)).tobytes()
    assert began([5, 6]).tobytes() == began(np.array([5, 6])).tobytes()
    one, other = began([5, 6]), began([5, 7])
    assert one[0].tobytes() == other[0].tobytes()
    assert one[1].tobytes() != other[1].tobytes()
    for seed in ([5], 1.5, [1.5, 2]):
        with pytest.raises((ValueError, TypeError)):
            began(seed)
    impacts.close()
    for act in (impacts.reset, lambda: impacts.step(np.zeros((2, 1)))):
        with pytest.raises(gymnasium.error.ClosedEnvironmentError):
            act()


@pytest.mark.parametrize("wrong", [{"limit_n": 0.0}, {"scale": np.nan}, {"num_envs": 0}])
def test_numbers_that_are_not_positive_are_refused(wrong):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))} = .*must be"):
        Impacts("aluminium-3mm", **wrong)
