"""Impacts as a Gymnasium environment, for controllers that are learnt: a batch of them a call."""

import math
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from hertzloop.elsewhere.batch import Batch
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup
from plant.contact.hertz import rigid_penetration_m

_AHEAD = 20  # samples before the first touch
_AFTER = 20  # samples after the sphere has left


class Impacts(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """First impacts of a scene, `num_envs` at a time; its law is not asked.

    An impact begins shortly before the touch and ends shortly after the sphere has left. An action
    is the force by `limit_n`, for one sample; it acts as late as a run's force, in whole samples.
    An observation is the latest sample by `scale` (for the gap, the depth on a rigid plate), and
    the latest action. The reward comes at the end: minus the share of the sphere's energy that the
    plate has taken. An impact that is over begins anew in the next call, whose action is ignored;
    seeds are drawn, so that noise and a random `run.touch_phase` differ. Raises SceneError,
    NoCompiler and CompileFault.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(
        self, setup: Setup, num_envs: int = 64, *, limit_n: float | None = None,
        scale: float | None = None,
    ) -> None:  # fmt: skip
        about = setup.about_bodies
        if scale is None and setup.quantity != "xi":
            raise SceneError(
                f"sensors.quantity = {setup.quantity!r} needs a scale for its "
                "observations; give `scale`, or sense 'xi'"
            )
        depth = rigid_penetration_m(about.sphere_mass_kg, about.stiffness, about.impact_speed_m_s)
        self.num_envs, self.scale = num_envs, scale or depth
        self.limit_n = limit_n or min(about.limit_n, about.rigid_peak_n)
        self.single_observation_space = gym.spaces.Box(-math.inf, math.inf, (2,), np.float64)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float64)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._every = setup.every_steps
        touch = math.floor(setup.first_touch_s / setup.step_s)
        self._first = max(touch // self._every - _AHEAD, 0) * self._every
        self._delay = math.ceil(about.horizon_steps / self._every)
        self._energy_j = 0.5 * about.sphere_mass_kg * about.impact_speed_m_s**2
        self._steps = setup.steps
        self.batch = Batch(setup, num_envs)
        # Commands under way (N), the next first; whether it has touched, samples apart since.
        self._line = np.zeros((num_envs, self._delay + 1))
        self._touched = np.zeros(num_envs, bool)
        self._apart = np.zeros(num_envs, int)
        self._over = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """All impacts anew."""
        super().reset(seed=seed if isinstance(seed, int) else None, options=options)
        for i in range(self.num_envs):
            self._begin(i)
        return self._seen(), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One sample of every impact."""
        going = np.flatnonzero(~self._over)
        for i in np.flatnonzero(self._over):
            self._begin(int(i))
        given = np.clip(np.asarray(actions, float).reshape(self.num_envs), -1.0, 1.0)
        self._line[going, -1] = given[going] * self.limit_n
        self.batch.step(going, self._line[going, 0], self._every)
        self._line[going] = np.roll(self._line[going], -1, axis=1)
        self._line[going, -1] = self._line[going, -2]
        in_contact = self.batch.values["gap_m"] <= 0.0
        self._touched |= in_contact
        self._apart = np.where(self._touched & ~in_contact, self._apart + 1, 0)
        terminated = self._apart > _AFTER
        truncated = self.batch.values["step"] + self._every > self._steps
        truncated &= ~terminated
        self._over = terminated | truncated
        rewards = np.zeros(self.num_envs)
        for i in np.flatnonzero(self._over):
            rewards[i] = -self._taken(int(i))
        return self._seen(), rewards, terminated, truncated, {}

    def close_extras(self, **kwargs: Any) -> None:
        """Let go of the plants."""
        self.batch.close()

    def _begin(self, index: int) -> None:
        self.batch.start(index, int(self.np_random.integers(2**62)), self._first)
        self._line[index] = 0.0
        self._touched[index] = self._over[index] = False
        self._apart[index] = 0

    def _seen(self) -> np.ndarray:
        last = self._line[:, -1] / self.limit_n
        return np.stack([self.batch.values["sample"] / self.scale, last], axis=1)

    def _taken(self, index: int) -> float:
        """The share of the sphere's energy that the plate has taken, with what it has lost."""
        found = self.batch.energies(index)
        names = "modal_j", "modal_dissipated_j", "air_dissipated_j", "tail_dissipated_j"
        return sum(found[name] for name in names) / self._energy_j
