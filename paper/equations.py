"""Equations 3.1, 3.3, 3.8b and the limits of 3.13 of the study, for a scene's first impact."""

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, start
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption, SceneArgument, SetOption
from hertzloop.cli.prepare import scene_from
from hertzloop.cli.terminal import fail
from hertzloop.loop.simulate import simulate
from hertzloop.plant.contact.hertz import tangent_stiffness_n_m
from hertzloop.plant.structures.radiation import (
    AIR_DENSITY_KG_M3,
    SOUND_SPEED_M_S,
    critical_frequency_hz,
    maidanik_from_hz,
)
from hertzloop.results.impacts import first_impact
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

_ALL = 1e12  # times the poles: all frequencies, to rounding


def longhorn_any_j(radius_m: float, speed_m_s: float, contact_time_s: float) -> float:
    """Eq. 3.1, acceleration noise of one change of speed over any contact time, J.

    (pi R^3/3) rho0 v0^2 x^-2 {1 - exp(-x) [cos x + sin x]}, x = c t0/R; its limit for x << 1
    is eq. 3.3, `longhorn_short_j`.
    """
    x = SOUND_SPEED_M_S * contact_time_s / radius_m
    # 1 - e^-x (cos x + sin x) = x^2 - 2/3 x^3 + x^4/6 + ...; the difference rounds away there.
    shape = 1.0 - 2.0 / 3.0 * x + x * x / 6.0
    if x > 1e-3:
        shape = (1.0 - math.exp(-x) * (math.cos(x) + math.sin(x))) / (x * x)
    return longhorn_short_j(radius_m, speed_m_s) * shape


def longhorn_short_j(radius_m: float, speed_m_s: float) -> float:
    """Eq. 3.3: (pi R^3/3) rho0 v0^2, J."""
    return math.pi * radius_m**3 / 3.0 * AIR_DENSITY_KG_M3 * speed_m_s**2


@dataclass(frozen=True)
class PointMobility:
    """Y_sys of eq. 3.8b: a mass (kg) on a massless spring (N/m) on an infinite plate (N s/m)."""

    mass_kg: float
    spring_n_m: float
    impedance_n_s_m: float

    def real(self, omega: float) -> float:
        """Re [(Y_p + j w/s)/(j w m Y_p + 1 - w^2 m/s)], m/(N s)."""
        m, s, y = self.mass_kg, self.spring_n_m, 1.0 / self.impedance_n_s_m
        above = complex(y, omega / s)
        return (above / complex(1.0 - omega**2 * m / s, omega * m * y)).real

    def share(self, omega_max: float = math.inf) -> float:
        """Integral of Re Y_sys up to a frequency (rad/s) times 2 m/pi: 1 for all, whatever the
        plate, as only the mass is moved at once.

        By the residues r of the two poles p, which lie left of the imaginary axis:
        the integral of r/(j w - p) is -j r log(j w - p).
        """
        m, s, y = self.mass_kg, self.spring_n_m, 1.0 / self.impedance_n_s_m
        poles = np.roots([m / s, m * y, 1.0]).astype(complex)
        residues = (y + poles / s) / (2.0 * poles * m / s + m * y)
        high = 1j * min(omega_max, _ALL * float(np.abs(poles).max()))
        total = np.sum(-1j * residues * (np.log(high - poles) - np.log(-poles)))
        return float(2.0 * m / math.pi * total.real)

    def energy_j(self, impulse_n_s: float, omega_max: float) -> float:
        """Eq. 3.8b, I^2/pi times the integral up to a frequency (rad/s), J."""
        return impulse_n_s**2 / (2.0 * self.mass_kg) * self.share(omega_max)


@dataclass(frozen=True)
class Line:
    """One number: which equation, of what, the number and its unit."""

    equation: str
    what: str
    value: float
    unit: str


def lines(setup: Setup) -> list[Line]:
    """Eq. 3.1, 3.3, 3.8b, and the limits of 3.13. Raises SceneError without an impact that ends."""
    setup = setup.without_control()
    spec = setup.plant
    impact = first_impact(setup, simulate(setup).truth)
    if impact is None or not impact.ended:
        raise SceneError("no impact ends within run.duration_s; take more")
    noise, sphere = impact.noise, spec.sphere
    time_s, v0, m = noise.contact_time_s, sphere.impact_speed_m_s, sphere.mass_kg
    any_j = longhorn_any_j(sphere.radius_m, v0, time_s)
    short_j = longhorn_short_j(sphere.radius_m, v0)
    ratio = SOUND_SPEED_M_S * time_s / sphere.radius_m
    found = [
        Line("3.1", "acceleration noise, any contact time", 1e6 * any_j, "uJ"),
        Line("3.3", "its limit for a short contact", 1e6 * short_j, "uJ"),
        Line("3.3", "limit over 3.1", short_j / any_j, ""),
        Line("3.3", "c t0/R; the limit needs much less than 1", ratio, ""),
    ]
    # The spring is as stiff as the contact at its peak.
    spring = tangent_stiffness_n_m(spec.contact.stiffness, impact.impact.peak_force_n)
    mobility = PointMobility(m, spring, spec.local_plate.infinite_plate_impedance_n_s_m)
    cuts = (("w < 1/T", 1.0 / time_s), ("w < 2 pi/T", 2.0 * math.pi / time_s))
    found += [
        Line("3.8b (i)", "2 m/pi times the integral of Re Y_sys", mobility.share(), ""),
        *[Line("3.8b (ii)", f"the same for {what}", mobility.share(w), "") for what, w in cuts],
        *[
            Line("3.8b", f"energy for {what}, I = {name}", 1e6 * mobility.energy_j(i, w), "uJ")
            for name, i in (("m v0", m * v0), ("sqrt(2) m v0", math.sqrt(2.0) * m * v0))
            for what, w in cuts
        ],
        Line("", "plate energy of the run", 1e6 * noise.transmitted_j, "uJ"),
        Line("", "... of the kinetic energy", noise.transmitted_j / (0.5 * m * v0**2), ""),
    ]
    plate = spec.plate.simply_supported
    if plate is not None:
        found += [
            Line("3.13", "not defined below", maidanik_from_hz(plate), "Hz"),
            Line("3.13", "critical frequency", critical_frequency_hz(plate), "Hz"),
        ]
    return found


_QUICK_S = 2e-3  # after the first touch


def main(
    scene: SceneArgument = "aluminium-3mm",
    settings: SetOption = None,
    folder: OutDirOption = None,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Compute equations 3.1, 3.3, 3.8b and the limits of 3.13 for a scene's first impact.

    The impact has no control. With --quick: the run ends 2 ms after the first touch.

    Example: python -m paper.equations aluminium-3mm
    """
    resolved = scene_from(scene, settings, None)
    if quick:
        steps = round((resolved.first_touch_s + _QUICK_S) / resolved.run.step_s)
        resolved = resolved.with_steps(min(resolved.run.steps, steps))
    with results_in(folder, "equations", resolved.run.scheme, json_file=json_file) as results:
        try:
            found = lines(resolved)
        except (SceneError, ValueError) as error:
            fail(str(error), 2)
        results.write("equations", found)
        results.table(
            f"{resolved.scene.name}, first impact without control",
            {
                "equation": "{.equation}",
                "what": "{.what}",
                "value": "{.value:.4g}",
                "unit": "{.unit}",
            },
            found,
            text=2,
        )
        ratio = next(one.value for one in found if one.what == "limit over 3.1")
        results.conclude(
            f"For the contact time of {resolved.scene.name}, the limit for a short contact "
            f"(eq. 3.3) is {ratio:.3g} times the acceleration noise of eq. 3.1."
        )


if __name__ == "__main__":
    start("paper.equations")
