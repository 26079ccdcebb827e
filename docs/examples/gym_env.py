"""The first impact of a scene as a Gymnasium environment, for a controller that is learnt."""

from collections import deque

import gymnasium as gym
import numpy as np

import hertzloop

DEPTH_M, LIMIT_N = 1e-5, 80.0  # an observation and an action of 1
KEYS = {"run.plate_model": "modal", "run.touch_phase": "random", "run.duration_s": 0.0012}


class ImpactEnv(gym.Env):
    """Action: the force; observation: the gap and the last action; reward: at the end of the run,
    minus the share of the sphere's energy that the plate has taken."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self, scene: str = "aluminium-3mm", latency_steps: int = 1) -> None:
        self.scene, self.latency_steps = hertzloop.load(scene, KEYS), latency_steps

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        drawn = {"run.seed": int(self.np_random.integers(2**62))}  # of noise and touch phase
        self.plant = hertzloop.Stepper(hertzloop.vary(self.scene, drawn))
        self.line = deque([0.0] * (1 + self.latency_steps))
        while self.plant.sample > 20 * DEPTH_M:  # the fall is no part of an episode
            self.plant.step(0.0)
        return self._seen(0.0), {}

    def step(self, action):
        share = float(np.clip(action[0], -1.0, 1.0))
        self.line.append(LIMIT_N * share)
        self.plant.step(self.line.popleft())
        over, reward = self.plant.steps_done == self.plant.steps, 0.0
        if over:
            energy = self.plant.balance()
            reward = -(energy.modal_j + energy.modal_dissipated_j) / energy.energy_start_j
        return self._seen(share), reward, over, False, {}

    def _seen(self, share: float) -> np.ndarray:
        return np.array([self.plant.sample / DEPTH_M, share], np.float32)
