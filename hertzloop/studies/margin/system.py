"""The plant in flight as a linear system for other programs: responses, state space, files."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
import scipy

from hertzloop.common.atomic_files import whole_file
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.linear import TransferFunction, plant_in_flight
from hertzloop.studies.margin.table import grid
from hertzloop.studies.pages.words import write_rows

if TYPE_CHECKING:
    import control

_MOST_STATES = 6000  # of a dense state space, 0.3 GB
ENDINGS = (".npz", ".csv", ".mat")


class StateSpace(NamedTuple):
    """Real matrices of x' = A x + B u, y = C x + D u; shapes (n, n), (n, 1), (1, n), (1, 1)."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray


@dataclass(frozen=True)
class LinearSystem(TransferFunction):
    """Response of the samples to the force of the actuator, from sample to sample, per newton.

    The latency of the scene's loop is `delay` samples more. It is not part of poles, residues and
    finite impulse response. Methods add it where `latency` is true.

    Attributes:
        step_s: sampling interval, s.
        quantity: name of the sensed quantity.
        unit: its unit.
        delay: whole samples from a sample to the force that it commands.
    """

    step_s: float
    quantity: str
    unit: str
    delay: int

    @classmethod
    def of(cls, setup: Setup, quantity: str | None = None) -> Self:
        """Return the system of a setup. Raises SceneError as `plant_in_flight`."""
        form = plant_in_flight(setup, quantity)
        every = setup.sensor.every_steps
        late = 1 + setup.signal_path.latency_steps + setup.signal_path.dead_steps
        held = form.held(every, late % every)
        name = quantity or setup.scene.sensors.quantity
        return cls(
            held.poles,
            held.residues,
            held.fir,
            every * setup.run.step_ns / 1e9,
            name,
            SENSED[name].unit,
            late // every,
        )

    def frequency_response(self, frequency_hz: Any, latency: bool = False) -> np.ndarray:
        """Return the complex response, unit of the quantity per N.

        Args:
            frequency_hz: of any shape, Hz.
            latency: whether to include the latency of the loop.
        """
        turn = 2j * np.pi * np.asarray(frequency_hz, float) * self.step_s
        found = self.at(np.exp(turn))
        return np.asarray(found * np.exp(-self.delay * turn) if latency else found)

    def resonance_grid_hz(self) -> np.ndarray:
        """Return frequencies from 0 to the Nyquist frequency that are dense at each pole, Hz."""
        return np.asarray(grid(self.poles) / (2.0 * np.pi * self.step_s))

    def impulse_response(self, samples: int) -> np.ndarray:
        """Return the response to a force of 1 N over one sampling interval, shape (samples,)."""
        found = np.zeros(samples)
        power = self.residues.copy()
        for k in range(1, samples):
            found[k] = power.real.sum()
            power *= self.poles
        found[:3] += self.fir[:samples]
        return found

    def to_statespace(self, latency: bool = False) -> StateSpace:
        """Return a dense real state space, block-diagonal, one block for each pole.

        Args:
            latency: whether to include the latency of the loop.

        Raises:
            ValueError: the matrix is too large to store densely.
        """
        late = self.delay if latency else 0
        count = len(self.poles) + 2 + late
        if count > _MOST_STATES:
            raise ValueError(
                f"state space: has {count} states; the limit is {_MOST_STATES}. Use poles and "
                "residues, or increase run.accuracy to have fewer modes."
            )
        a, b, c = np.zeros((count, count)), np.zeros((count, 1)), np.zeros((1, count))
        at = 0
        upper = self.poles.imag >= 0.0
        for pole, residue in zip(self.poles[upper], self.residues[upper], strict=True):
            states = 1 if pole.imag == 0.0 else 2
            size = math.sqrt(states * abs(residue)) or 1.0
            b[at, 0] = size
            c[0, at : at + 2] = states * np.array([residue.real, -residue.imag]) / size
            turn = np.array([[pole.real, -pole.imag], [pole.imag, pole.real]])
            a[at : at + states, at : at + states] = turn[:states, :states]
            at += states
        b[at, 0], a[at + 1, at] = 1.0, 1.0
        c[0, at : at + 2] = self.fir[1:]
        if late:  # a chain of commands in front of what the force drives
            first = at + 2
            a[:, -1:] += b
            b = np.zeros((count, 1))
            b[first, 0] = 1.0
            a[np.arange(first + 1, count), np.arange(first, count - 1)] = 1.0
        return StateSpace(a, b, c, np.zeros((1, 1)))

    def to_control(self, latency: bool = False) -> "control.StateSpace":
        """Return a discrete state space of python-control (extra `control`).

        The margins of python-control fail from a few lightly damped modes on. Use
        `hertzloop margin` for these.
        """
        need("control")
        import control

        return control.ss(
            *self.to_statespace(latency), self.step_s, inputs=["force_n"], outputs=[self.quantity]
        )

    def save(self, path: str | Path, statespace: bool = False) -> None:
        """Write the system to a file.

        A file `.npz` or `.mat` has poles, residues, fir, step_s, delay, quantity, unit,
        frequency_hz and response. A file `.csv` has the frequency response on the resonance grid.

        Args:
            path: of the file; its ending chooses the format.
            statespace: whether to add the dense matrices a, b, c, d.

        Raises:
            ValueError: the ending is unknown, or the state space is too large.
            OSError: the file cannot be written.
        """
        path = Path(path)
        if path.suffix not in ENDINGS:
            raise ValueError(f"{path}: unknown format. Use a file that ends in .npz, .csv or .mat.")
        frequency_hz = self.resonance_grid_hz()
        response = self.frequency_response(frequency_hz)
        if path.suffix == ".csv":
            rows = zip(frequency_hz, response.real, response.imag, strict=True)
            write_rows(path, ["frequency_hz", "real", "imag"], rows)
            return
        arrays: dict[str, Any] = {
            "poles": self.poles,
            "residues": self.residues,
            "fir": self.fir,
            "step_s": self.step_s,
            "delay": self.delay,
            "quantity": self.quantity,
            "unit": self.unit,
            "frequency_hz": frequency_hz,
            "response": response,
        }
        if statespace:
            arrays |= self.to_statespace()._asdict()
        with whole_file(path) as unfinished:
            if path.suffix == ".npz":
                np.savez(unfinished, **arrays)
            else:
                scipy.io.savemat(unfinished, arrays)
