"""The plant in flight as a linear sampled system, from the coefficients of its kernels.

A command of step k first reaches the sample of step k + 1, so the response is strictly proper:
P(Z) = sum of [R/(Z - p) + conjugate] + sum of real poles + b_1/Z + b_2/Z^2.
"""

from dataclasses import dataclass

import numpy as np

from hertzloop.plant.actuator import LinearActuator, linear_form
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.schemes.modal_kernels import ModalModel
from hertzloop.plant.structures.linear import IM, RE, V, X
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.sensors.kernels import SensorModel

_CHUNK = 1 << 21  # complex numbers at a time
_COINCIDE = 1e-12  # distance of two poles that are taken for one
_TRIED = 1.0001 * np.exp(1j * np.geomspace(1e-4, 3.1, 32))  # where the filters are checked
_TOLD = 1e-9  # error of their sum over poles


@dataclass(frozen=True)
class PoleForm:
    """A strictly proper real transfer function in 1/Z.

    Attributes:
        poles: one of each conjugate pair, and real poles; shape (n,), complex.
        residues: of these; a real pole has half its residue, as its conjugate is added, shape (n,).
        fir: coefficients of 1/Z and 1/Z^2, shape (2,).
    """

    poles: np.ndarray
    residues: np.ndarray
    fir: np.ndarray

    def both_of_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all poles and their whole residues: both poles of each conjugate pair."""
        paired = self.poles.imag != 0.0
        whole = np.where(paired, self.residues, 2.0 * self.residues)
        return (
            np.concatenate([self.poles, self.poles[paired].conj()]),
            np.concatenate([whole, self.residues[paired].conj()]),
        )

    def at(self, z: np.ndarray) -> np.ndarray:
        """Return the response at complex numbers `z` of any shape."""
        points = np.atleast_1d(np.asarray(z, complex)).ravel()
        found = self.fir[0] / points + self.fir[1] / points**2
        rows = max(1, _CHUNK // max(1, len(self.poles)))
        for i in range(0, len(points), rows):
            part = points[i : i + rows, None]
            found[i : i + rows] += (1.0 / (part - self.poles)) @ self.residues
            found[i : i + rows] += (1.0 / (part - self.poles.conj())) @ self.residues.conj()
        return found.reshape(np.shape(z))

    def filtered(self, direct: float, poles: np.ndarray, residues: np.ndarray) -> "PoleForm":
        """Return it times direct + sum of residues/(Z - poles), a real filter.

        Args:
            direct: response at infinite Z.
            poles: distinct and not zero, both of each conjugate pair, shape (n,).
            residues: of these, shape (n,).

        Raises:
            SceneError: a pole of the filter is a pole of this response.
        """
        poles, residues = np.asarray(poles, complex), np.asarray(residues, complex)
        if np.any(np.abs(poles[:, None] - self.poles) < _COINCIDE):
            raise SceneError(
                "sensors: a filter has a pole of the plant or of another filter, and the margin "
                "needs distinct ones. Change its frequency slightly."
            )
        own = direct + (residues / (self.poles[:, None] - poles)).sum(axis=1)
        at_poles = residues * self.at(poles)
        at_0 = direct - np.sum(residues / poles).real
        slope_0 = -np.sum(residues / poles**2).real
        upper = poles.imag >= 0.0
        half = np.where(poles.imag == 0.0, 0.5, 1.0)[upper]  # its conjugate is added
        return PoleForm(
            np.append(self.poles, poles[upper]),
            np.append(self.residues * own, half * at_poles[upper]),
            np.array([self.fir[0] * at_0 + self.fir[1] * slope_0, self.fir[1] * at_0]),
        )

    def difference(self, step_s: float) -> "PoleForm":
        """Return it times (1 - 1/Z)/h, the mean acceleration of a velocity."""
        residues = self.residues * (1.0 - 1.0 / self.poles) / step_s
        first = self.fir[0] + 2.0 * np.sum((self.residues / self.poles).real)
        return PoleForm(self.poles, residues, np.array([first, self.fir[1] - self.fir[0]]) / step_s)

    def held(self, every: int, shift: int) -> "PoleForm":
        """Return the response from sample to sample, `every` steps apart, to a command that is held
        and acts `shift` steps (0 to every - 1) late."""
        if every == 1:
            return self
        p, n, r = self.poles, every, shift
        whole = self.residues * p ** (-r) * np.expm1(n * np.log(p)) / (p - 1.0)
        first = 2.0 * np.sum((self.residues * (p ** (-r) - 1.0) / (p - 1.0)).real) + self.fir[0]
        late = self.fir[1]
        fir = np.array([first + late, 0.0]) if n - r >= 2 else np.array([first, late])
        return PoleForm(p**n, whole, fir)

    def in_step(self, every: int, step: int) -> "PoleForm":
        """Return the response from sample to sample, `every` steps apart, to a force in one step
        alone, `step` steps (0 to every - 1) after a sample."""
        if every == 1:
            return self
        first = {every - 1: self.fir[0], every - 2: self.fir[1]}.get(step, 0.0)
        residues = self.residues * self.poles ** (every - 1 - step)
        return PoleForm(self.poles**every, residues, np.array([first, 0.0]))


def _through_actuator(by_mean: PoleForm, by_slope: PoleForm, actuator: LinearActuator) -> PoleForm:
    own, vectors = np.linalg.eig(actuator.a)
    if len(own) > 1 and abs(own[0] - own[1]) < 1e-9:
        raise SceneError(
            "actuator: its two poles coincide, and the margin needs distinct ones. "
            "Change the damping ratio slightly."
        )
    entry = np.linalg.solve(vectors, actuator.b.astype(complex))
    exits = actuator.state @ vectors * entry  # residues, shape (2 outputs, n poles)

    def passes(row: int, z: np.ndarray) -> np.ndarray:
        z = np.asarray(z, complex)
        return np.asarray(actuator.command[row] + (exits[row] / (z[..., None] - own)).sum(axis=-1))

    residues = by_mean.residues * passes(0, by_mean.poles)
    residues = residues + by_slope.residues * passes(1, by_mean.poles)
    of_own = by_mean.at(own) * exits[0] + by_slope.at(own) * exits[1]
    zero = np.array([0.0 + 0.0j])
    first = by_mean.fir[0] * passes(0, zero)[0].real + by_slope.fir[0] * passes(1, zero)[0].real
    half = np.where(own.imag == 0.0, 0.5, 1.0)[own.imag >= 0.0]  # its conjugate is added
    of_own, own = half * of_own[own.imag >= 0.0], own[own.imag >= 0.0]
    return PoleForm(
        np.append(by_mean.poles, own), np.append(residues, of_own), np.array([first, 0.0])
    )


def through_sensor(form: PoleForm, sensor: SensorModel) -> PoleForm:
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


def plant_in_flight(setup: Setup, quantity: str | None = None) -> PoleForm:
    """Return the response of the samples to a force command while the sphere is in flight.

    The filters of the data acquisition are part of it; sampling every n steps is not: see
    `PoleForm.held`.

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


def by_command(model: ModalModel, gap: bool) -> PoleForm:
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
    forms = [
        PoleForm(poles, 0.5 * weight * drive, np.array([fir, 0.0]))
        for drive, fir in zip((by_mean, by_slope), first, strict=True)
    ]
    return _through_actuator(forms[0], forms[1], linear_form(model.actuator))
