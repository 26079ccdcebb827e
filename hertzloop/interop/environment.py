"""Impacts as Gymnasium environments, for controllers that are learnt: one, or a batch a call."""

import ctypes
import math
import operator
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from hertzloop.interop.fmu import ENERGIES, VALUES, write_library
from hertzloop.interop.image import image
from hertzloop.interop.objects import HOST
from hertzloop.plant.contact.hertz import rigid_penetration_m
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Resolvable, Setup, load, resolve

_AHEAD = 20  # samples before the first touch
_AFTER = 20  # samples after the sphere has left
_TAKEN = ("modal_j", "modal_dissipated_j", "truncated_dissipated_j")
_INVALID = -1.0  # reward of an action that is no number, as if the plate had taken all energy


def _positive(name: str, value: float) -> float:
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} = {value}: must be a positive number.")
    return value


class Impacts(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """First impacts of a scene, `num_envs` at a time; its law is not asked.

    An impact begins shortly before the touch and ends shortly after the sphere has left. An action
    is the force by `limit_n`, for one sample; it acts as late as a run's force, in whole samples.
    An observation is the latest sample by `scale` (for the gap, the depth on a rigid plate), and
    the latest action. The reward comes at the end: minus the share of the sphere's energy that the
    plate has taken. An impact that is over begins anew in the next call, whose action is ignored;
    seeds are drawn, so that noise and a random `run.touch_phase` differ. An action of nan ends its
    own impact with a reward of -1; `info["invalid_action"]` tells which. `scene` may be a name or
    a TOML file. Raises SceneError, NoCompiler and CompileFault, and ValueError for a `num_envs`,
    `limit_n` or `scale` that is not positive.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scene: Resolvable | str | Path,
        num_envs: int = 64,
        *,
        limit_n: float | None = None,
        scale: float | None = None,
    ) -> None:
        setup = load(str(scene)) if isinstance(scene, str | Path) else resolve(scene)
        about = setup.about_mechanics
        if scale is None and setup.quantity != "xi":
            raise SceneError(
                f"sensors.quantity = {setup.quantity!r} needs a scale for its "
                "observations; give `scale`, or sense 'xi'"
            )
        depth = rigid_penetration_m(
            about.sphere_mass_kg, about.stiffness, about.impact_speed_m_s, about.exponent
        )
        if num_envs < 1:
            raise ValueError(f"num_envs = {num_envs}: must be at least 1.")
        self.num_envs = num_envs
        self.scale = _positive("scale", depth if scale is None else scale)
        smaller = min(about.limit_n, about.rigid_peak_n)
        self.limit_n = _positive("limit_n", smaller if limit_n is None else limit_n)
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
        self._begun = False
        self._drawn_from = [self.np_random] * num_envs

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin all impacts anew.

        Args:
            seed: one of them all, or a list with one of each; None goes on drawing.
            options: not used.

        Raises:
            ValueError: another number of seeds than environments.
            TypeError: a seed that is no whole number.
            ClosedEnvironmentError: the environment is closed.
        """
        self._refuse_if_closed()
        if seed is None or isinstance(seed, int | np.integer):
            super().reset(seed=None if seed is None else int(seed), options=options)
            if seed is not None:
                self._drawn_from = [self.np_random] * self.num_envs
        else:
            seeds = list(seed)
            if len(seeds) != self.num_envs:
                raise ValueError(
                    f"seed = {seeds}: has {len(seeds)} seeds for {self.num_envs} environments. "
                    "Give one number, or one for each environment."
                )
            for i, one in enumerate(seeds):
                if one is not None:
                    self._drawn_from[i] = np_random(operator.index(one))[0]
        for i in range(self.num_envs):
            self._begin(i)
        self._begun = True
        return self._seen(), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step every impact by one sample. Raises ClosedEnvironmentError and ResetNeeded."""
        self._refuse_if_closed()
        if not self._begun:
            raise gym.error.ResetNeeded("no impact has begun. Call reset first.")
        going = np.flatnonzero(~self._over)
        for i in np.flatnonzero(self._over):
            self._begin(int(i))
        given = np.clip(np.asarray(actions, float).reshape(self.num_envs), -1.0, 1.0)
        invalid = np.zeros(self.num_envs, bool)
        invalid[going] = np.isnan(given[going])
        given[invalid] = 0.0
        self._line[going, -1] = given[going] * self.limit_n
        self.batch.step(going, self._line[going, 0], self._every)
        self._line[going] = np.roll(self._line[going], -1, axis=1)
        self._line[going, -1] = self._line[going, -2]
        in_contact = self.batch.values["gap_m"] <= 0.0
        self._touched |= in_contact
        self._apart = np.where(self._touched & ~in_contact, self._apart + 1, 0)
        terminated = (self._apart > _AFTER) | invalid
        truncated = self.batch.values["step"] + self._every > self._steps
        truncated &= ~terminated
        self._over = terminated | truncated
        rewards = np.zeros(self.num_envs)
        for i in np.flatnonzero(self._over):
            # The share of the sphere's energy that the plate has taken, with what it has lost.
            energies = self.batch.energies(int(i))
            taken = sum(energies[name] for name in _TAKEN) / self._energy_j
            rewards[i] = _INVALID if invalid[i] else -taken
        return self._seen(), rewards, terminated, truncated, {"invalid_action": invalid}

    def close_extras(self, **kwargs: Any) -> None:
        """Let go of the plants."""
        self.batch.close()

    def _refuse_if_closed(self) -> None:
        if self.closed:  # its plants are gone
            raise gym.error.ClosedEnvironmentError("the environment is closed. Make another one.")

    def _begin(self, index: int) -> None:
        self.batch.start(index, int(self._drawn_from[index].integers(2**62)), self._first)
        self._line[index] = 0.0
        self._touched[index] = self._over[index] = False
        self._apart[index] = 0

    def _seen(self) -> np.ndarray:
        last = self._line[:, -1] / self.limit_n
        return np.stack([self.batch.values["sample"] / self.scale, last], axis=1)


class ImpactEnv(gym.Env[np.ndarray, np.ndarray]):
    """First impacts of a scene, one at a time, for programs that train one environment.

    Actions, observations and rewards are those of `hertzloop.interop.environment.Impacts`, in
    single precision; that class steps many impacts a call and is faster.

    Args:
        scene: the scene, or its name or TOML file; its law is not asked.
        limit_n: force of an action of 1, N; by default the smaller of the actuator's limit and the
            peak force on a rigid plate.
        scale: sample that is observed as 1; by default, for the gap, the depth on a rigid plate, m.

    Raises:
        SceneError: the scene cannot be simulated, or needs `scale`.
        NoCompiler: there is no C compiler.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scene: Resolvable | str | Path,
        *,
        limit_n: float | None = None,
        scale: float | None = None,
    ) -> None:
        self._one = Impacts(scene, 1, limit_n=limit_n, scale=scale)
        self.limit_n, self.scale = self._one.limit_n, self._one.scale
        self.observation_space = gym.spaces.Box(-math.inf, math.inf, (2,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._going = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin another impact. Raises ClosedEnvironmentError."""
        super().reset(seed=seed)
        seen, _ = self._one.reset(seed=int(self.np_random.integers(2**62)))
        self._going = True
        return seen[0].astype(np.float32), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Step the impact by one sample. Raises ClosedEnvironmentError, and ResetNeeded where none
        has begun or it is over."""
        if not self._going and not self._one.closed:
            raise gym.error.ResetNeeded("the impact is over, or none has begun. Call reset first.")
        seen, reward, terminated, truncated, info = self._one.step(np.asarray(action))
        over, cut = bool(terminated[0]), bool(truncated[0])
        self._going = not (over or cut)
        told = {"invalid_action": bool(info["invalid_action"][0])}
        return seen[0].astype(np.float32), float(reward[0]), over, cut, told

    def close(self) -> None:
        """Let go of the plant."""
        self._one.close()


class Batch:
    """Some plants of one scene; `values`: what each showed last, of the fields of VALUES.

    Raises SceneError, NoCompiler and CompileFault.
    """

    def __init__(self, setup: Setup, count: int) -> None:
        self._folder = TemporaryDirectory(prefix="hertzloop-")
        library = Path(self._folder.name) / "plants.so"
        write_library(image(setup), HOST, library)
        self._c = ctypes.CDLL(str(library))
        self._c.hertzloop_plant_new.restype = ctypes.c_void_p
        self._c.hertzloop_plant_said.restype = ctypes.c_char_p
        self._c.hertzloop_plant_step_all.restype = ctypes.c_int64
        self.setup = setup
        self.values = np.zeros(count, VALUES)
        self._plants = np.zeros(count, np.intp)
        for i in range(count):
            self._plants[i] = self._c.hertzloop_plant_new() or 0
            if not self._plants[i]:
                self.close()
                raise MemoryError(f"there is no memory for {count} plants")

    def start(self, index: int, seed: int, steps: int) -> None:
        """Put a plant to its start, with a seed, and let it fall for some steps."""
        plant = ctypes.c_void_p(int(self._plants[index]))
        height = ctypes.c_double(self.setup.sphere.drop_height_m)
        self._c.hertzloop_plant_reset(plant, height, ctypes.c_int64(seed))
        self._c.hertzloop_plant_step(plant, ctypes.c_double(0.0), ctypes.c_int64(steps))
        seen = self.values.ctypes.data + index * VALUES.itemsize
        self._c.hertzloop_plant_values(plant, ctypes.c_void_p(seen))

    def step(self, which: np.ndarray, commands_n: np.ndarray, steps: int) -> None:
        """Steps of the plants `which` (indices), each under a command. Raises ValueError."""
        plants, forces = self._plants[which], np.ascontiguousarray(commands_n, float)
        seen = np.zeros(len(plants), VALUES)
        went = self._c.hertzloop_plant_step_all(
            ctypes.c_void_p(plants.ctypes.data),
            ctypes.c_void_p(forces.ctypes.data),
            ctypes.c_int64(len(plants)),
            ctypes.c_int64(steps),
            ctypes.c_void_p(seen.ctypes.data),
        )
        self.values[which[:went]] = seen[:went]
        if went < len(plants):
            plant = ctypes.c_void_p(int(plants[went]))
            raise ValueError(self._c.hertzloop_plant_said(plant).decode())

    def energies(self, index: int) -> dict[str, float]:
        """Energies of a plant, by name."""
        found = (ctypes.c_double * len(ENERGIES))()
        self._c.hertzloop_plant_energies(ctypes.c_void_p(int(self._plants[index])), found)
        return dict(zip(ENERGIES, found, strict=True))

    def close(self) -> None:
        """Let go of the plants."""
        for plant in self._plants[self._plants != 0]:
            self._c.hertzloop_plant_free(ctypes.c_void_p(int(plant)))
        self._plants[:] = 0
        self._folder.cleanup()
