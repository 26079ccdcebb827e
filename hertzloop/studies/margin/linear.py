"""The plant in flight as a linear sampled system, from the poles of `Linear`.

A command of step k first reaches the sample of step k + 1, so the response is strictly proper.
"""

from dataclasses import dataclass

import numpy as np

from hertzloop.plant.actuator import linear_form
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.schemes.modal_kernels import ModalModel
from hertzloop.plant.structures.linear import IM, RE, V, X
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.sensors.kernels import SensorModel
from hertzloop.studies.margin.sums_kernels import pole_sums

_COINCIDE = 1e-12  # distance of two poles that are taken for one
_TRIED = 1.0001 * np.exp(1j * np.geomspace(1e-4, 3.1, 32))  # where the filters are checked
_TOLD = 1e-9  # error of their sum over poles


@dataclass(frozen=True)
class TransferFunction:
    """A real transfer function: the sum of R/(Z - p) and of b_k/Z^k.

    Attributes:
        poles: both of each conjugate pair, and real poles, shape (n,), complex.
        residues: of these, shape (n,).
        fir: coefficients of 1, 1/Z, 1/Z^2, ...; three of a plant, the first of them zero.
    """

    poles: np.ndarray
    residues: np.ndarray
    fir: np.ndarray

    @classmethod
    def of_taps(cls, *fir: float) -> "TransferFunction":
        """Return the sum of b_k/Z^k alone."""
        return cls(np.empty(0, complex), np.empty(0, complex), np.array(fir))

    @classmethod
    def of_modes(
        cls, poles: np.ndarray, residues: np.ndarray, fir: np.ndarray
    ) -> "TransferFunction":
        """Return the sum of residues/(Z - poles) and of its conjugate; the poles come first.

        Args:
            poles: one of each pair, shape (modes,).
            residues: of these; of a real pole half of it.
            fir: as of the class.
        """
        pairs = poles.imag != 0.0
        whole = np.where(pairs, residues, 2.0 * residues.real)
        return cls(
            np.concatenate([poles, poles[pairs].conj()]),
            np.concatenate([whole, residues[pairs].conj()]),
            fir,
        )

    def at(self, z: np.ndarray) -> np.ndarray:
        """Return the response at complex numbers `z` of any shape."""
        z = np.asarray(z, complex)
        return self.with_slope(z.ravel())[0].reshape(z.shape)

    def with_slope(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the response and its derivative by Z, at complex `z` of shape (n,)."""
        value, slope, _ = sums_at(z, self.poles, self.residues)
        return self.with_taps(z, value, slope)

    def with_taps(
        self, z: np.ndarray, value: np.ndarray, slope: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return a sum over poles and its derivative with those of the terms in 1/Z added."""
        near, taps = 1.0 / z, self.fir[::-1]
        change = near * near * np.polyval(np.polyder(taps), near)
        return value + np.polyval(taps, near), slope - change

    def filtered(
        self, direct: float, poles: np.ndarray, residues: np.ndarray
    ) -> "TransferFunction":
        """Return it times direct + sum of residues/(Z - poles), a real filter.

        Args:
            direct: response at infinite Z.
            poles: distinct and not zero, both of each conjugate pair, shape (n,).
            residues: of these, shape (n,).

        Raises:
            SceneError: a pole of the filter is a pole of this response.
        """
        poles, residues = np.asarray(poles, complex), np.asarray(residues, complex)
        apart = poles[:, None] - np.concatenate([self.poles, poles])
        apart[:, len(self.poles) :] += np.eye(len(poles))
        if np.any(np.abs(apart) < _COINCIDE):
            raise SceneError(
                "sensors: a filter, or the actuator, has a pole of the plant or of another filter, "
                "and the margin needs distinct ones. Change its frequency slightly."
            )
        _, first, second = self.fir
        own = direct + (residues / (self.poles[:, None] - poles)).sum(axis=1)
        at_0 = direct - np.sum(residues / poles).real
        slope_0 = -np.sum(residues / poles**2).real
        return TransferFunction(
            np.append(self.poles, poles),
            np.append(self.residues * own, residues * self.at(poles)),
            np.array([0.0, first * at_0 + second * slope_0, second * at_0]),
        )

    def difference(self, step_s: float) -> "TransferFunction":
        """Return it times (1 - 1/Z)/h, the mean acceleration of a velocity."""
        _, first, second = self.fir
        at_once = first + np.sum(self.residues / self.poles).real
        residues = self.residues * (1.0 - 1.0 / self.poles) / step_s
        fir = np.array([0.0, at_once, second - first]) / step_s
        return TransferFunction(self.poles, residues, fir)

    def held(self, every: int, shift: int) -> "TransferFunction":
        """Return the response from sample to sample, `every` steps apart, to a command that is held
        and acts `shift` steps (0 to every - 1) late."""
        if every == 1:
            return self
        p, late = self.poles, self.residues * self.poles ** (-shift) / (self.poles - 1.0)
        first = np.sum(late - self.residues / (p - 1.0)).real + self.fir[1]
        fir = np.array([0.0, first, self.fir[2]])
        if every - shift >= 2:
            fir = np.array([0.0, first + self.fir[2], 0.0])
        return TransferFunction(p**every, late * np.expm1(every * np.log(p)), fir)

    def in_step(self, every: int, step: int) -> "TransferFunction":
        """Return the response from sample to sample, `every` steps apart, to a force in one step
        alone, `step` steps (0 to every - 1) after a sample."""
        if every == 1:
            return self
        first = {every - 1: self.fir[1], every - 2: self.fir[2]}.get(step, 0.0)
        residues = self.residues * self.poles ** (every - 1 - step)
        return TransferFunction(self.poles**every, residues, np.array([0.0, first, 0.0]))


def sums_at(
    z: np.ndarray, poles: np.ndarray, residues: np.ndarray, skip: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the sums of r/(z - p), of -r/(z - p)^2 and of 1/(z - p) over poles p.

    Args:
        z: points, complex, shape (n,).
        poles, residues: complex, shape (poles,).
        skip: number of the pole that a point leaves out, shape (n,); None for none.
    """
    found, none = np.zeros((6, len(z))), np.full(len(z), -1)
    pole_sums(z.real.copy(), z.imag.copy(), poles, residues, none if skip is None else skip, found)
    value, slope, near = found[::2] + 1j * found[1::2]
    return value, slope, near


def through_sensor(form: TransferFunction, sensor: SensorModel) -> TransferFunction:
    """Return a response behind the filters of a channel.

    Raises:
        SceneError: the poles of the filters cannot be told apart in double precision.
    """
    expected = form.at(_TRIED)
    for m00, m01, m10, m11, ramp_0, ramp_1, low in sensor.sections:
        own, ramp, sign = (
            np.array([[m00, m01], [m10, m11]]),
            np.array([ramp_0, ramp_1]),
            2 * low - 1,
        )
        poles, vectors = np.linalg.eig(own)
        # Output less input is (Z - own)^-1 ramp (Z - 1) u.
        by_input = np.linalg.solve(vectors, (own @ ramp - ramp).astype(complex))
        moves = np.abs(poles) > 1e-100
        residues = sign * (vectors[0] * by_input)[moves]
        form = form.filtered(low + sign * ramp_0, poles[moves], residues)
        off = (ramp_0 * (_TRIED - m11) + m01 * ramp_1) * (_TRIED - 1.0)
        off /= (_TRIED - m00) * (_TRIED - m11) - m01 * m10
        expected = expected * (low + sign * off)
    error = np.max(np.abs(form.at(_TRIED) - expected))
    if not error <= _TOLD * np.max(np.abs(expected)):
        raise SceneError(
            "sensors: poles of the filters are too close to each other or decay within a step, and "
            "the margin needs distinct ones. Leave out a sensors.low_pass_hz beyond the rate of "
            "the steps, or reduce sensors.low_pass_order."
        )
    return form


def plant_in_flight(setup: Setup, quantity: str | None = None) -> TransferFunction:
    """Return the response of the samples to a force command while the sphere is in flight.

    The filters of the data acquisition are part of it; sampling every n steps is not: see
    `TransferFunction.held`.

    Args:
        setup: the run.
        quantity: "v_p", "acceleration" or "xi"; that of the scene if left out.

    Raises:
        SceneError: the scheme or the quantity has no such response.
    """
    quantity = quantity or setup.scene.sensors.quantity
    if quantity not in ("v_p", "acceleration", "xi"):
        raise SceneError(
            f"sensors.quantity = '{quantity}': has no linear response in flight. "
            "Use 'v_p', 'acceleration' or 'xi'."
        )
    model = linear_plant(setup).model
    form = by_command(model, gap=quantity == "xi")
    form = through_sensor(form, build_sensor(setup).model)
    return form.difference(model.step_s) if quantity == "acceleration" else form


def linear_plant(setup: Setup) -> ModalPlant:
    """Return the plant with its modes. Raises SceneError for another scheme."""
    plant = build_plant(setup.with_plate_model("modal"), flight=True)
    if not isinstance(plant, ModalPlant):
        raise SceneError(
            "run.scheme: the margin needs the scheme 'modal'. Set run.scheme = 'modal'."
        )
    return plant


def by_command(model: ModalModel, gap: bool) -> TransferFunction:
    """Return the response to a command of the gap, or of the plate velocity where the sensor is."""
    linear, force = model.linear, model.actuator_force
    there = np.any(linear.turn != 0.0, axis=0)  # the rest fills up a multiple of eight

    def numbers(pairs: np.ndarray) -> np.ndarray:
        return np.asarray(pairs[..., RE, there] + 1j * pairs[..., IM, there])

    poles, by_mean, by_slope = (numbers(part) for part in (linear.turn, *linear.drive[force]))
    if gap:
        weight, at_once = -numbers(linear.see[0, X]).conj(), 0.0
    else:
        weight = numbers(linear.see[model.sensor_point, V]).conj()
        at_once = float(linear.direct[model.sensor_point, force])
    first = [at_once, at_once]
    if gap:
        first = [-model.raised_by_m_n] * 2
    elif model.sensor_point == 0:
        first[1] += 2.0 * model.raised_by_m_n / model.step_s
    actuator = linear_form(model.actuator)
    own, vectors = np.linalg.eig(actuator.a)
    entry = np.linalg.solve(vectors, actuator.b.astype(complex))
    mean, slope = (
        TransferFunction.of_modes(poles, 0.5 * weight * drive, np.array([0.0, fir, 0.0])).filtered(
            command, own, exits @ vectors * entry
        )
        for drive, fir, command, exits in zip(
            (by_mean, by_slope), first, actuator.command, actuator.state, strict=True
        )
    )
    return TransferFunction(mean.poles, mean.residues + slope.residues, mean.fir + slope.fir)
