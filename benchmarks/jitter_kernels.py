"""Compiled simulation of a linear loop whose commands are late by amounts that vary."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel

_LARGE, _FLOOR = 1e60, 1e-280


class SimulatedLoop(NamedTuple):
    """A plant of poles and residues with a law of at most one pole.

    Attributes:
        poles, residues: of the plant, from force to velocity, shape (modes,).
        fir: coefficients of 1, which is zero, 1/Z and 1/Z^2, shape (3,).
        law: direct gain, pole and residue of the law, shape (3,).
        every: steps from one sample to the next.
        delay: steps from a sample to the force of its command at the shortest latency.
    """

    poles: np.ndarray
    residues: np.ndarray
    fir: np.ndarray
    law: np.ndarray
    every: int
    delay: int


@kernel
def simulate(loop, state, commands, late, weights, most, log_energy):
    """Write the log energy at every sample, and return nothing.

    A command acts `late` steps after the shortest latency, in order. Where `late` is empty, the
    command of each step is chosen among those up to `most` steps late so that the weighted energy
    after the step is largest, in order.

    Args:
        loop: the loop.
        state: of the plant at the start, is overwritten, shape (modes,).
        commands: room for the commands, shape (samples,).
        late: delay of each command, steps, shape (samples,) or (0,).
        weights: of the modes in the energy, shape (modes,).
        most: largest delay, steps.
        log_energy: shape (samples,).
    """
    modes, samples = state.size, commands.size
    force = before = kept = scale = 0.0
    acting = -1
    for k in range(samples * loop.every):
        if k % loop.every == 0:
            j = k // loop.every
            sample, energy = loop.fir[1] * force + loop.fir[2] * before, 0.0
            for m in range(modes):
                sample += 2.0 * state[m].real
                energy += weights[m] * (state[m].real ** 2 + state[m].imag ** 2)
            commands[j] = loop.law[0] * sample + kept
            kept = loop.law[1] * kept + loop.law[2] * sample
            log_energy[j] = math.log(max(energy, _FLOOR)) + scale
            if energy > _LARGE or (0.0 < energy < 1.0 / _LARGE):
                factor = 1.0 / math.sqrt(energy)
                scale += math.log(energy)
                force, before, kept = factor * force, factor * before, factor * kept
                for m in range(modes):
                    state[m] *= factor
                for i in range(j + 1):
                    commands[i] *= factor
        newest = (k - loop.delay) // loop.every if k >= loop.delay else -1
        if late.size > 0:
            while (
                acting < newest and (acting + 1) * loop.every + loop.delay + late[acting + 1] <= k
            ):
                acting += 1
        elif newest >= 0:
            gain = size = 0.0
            for m in range(modes):
                ahead = loop.poles[m] * state[m]
                gain += 2.0 * weights[m] * (ahead.conjugate() * loop.residues[m]).real
                size += weights[m] * abs(loop.residues[m]) ** 2
            oldest = (k - loop.delay - most) // loop.every if k >= loop.delay + most else -1
            first, best = max(acting, oldest), -math.inf
            for i in range(first, newest + 1):
                command = commands[i] if i >= 0 else 0.0
                grows = gain * command + size * command * command
                if grows >= best:
                    best, acting = grows, i
        before, force = force, commands[acting] if acting >= 0 else 0.0
        for m in range(modes):
            state[m] = loop.poles[m] * state[m] + loop.residues[m] * force
