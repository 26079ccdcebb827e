"""The study's pre-computed forces F_a1 to F_a13, and the early alternative of its appendix A.1.

All but the last follow from the contact force F_c0 of the same impact without control; its
duration T0 is that of F_c0. They are shifted by `controller.delay_us` = (t_a - 1) dt.
"""

from functools import lru_cache

import numpy as np

from hertzloop.scene import Scene, SceneError
from plant.contact import rigid_contact_time_s

CONSTANT, CONTACT_FORCE, SINE, COSINE = "constant", "contact_force", "sine", "cosine"
# F_a3 to F_a5 are F_a2 at another shift or under a sweep of it, and so on.
SHAPES = {
    "F_a1": CONSTANT,
    **{f"F_a{i}": CONTACT_FORCE for i in range(2, 6)},
    **{f"F_a{i}": SINE for i in range(6, 10)},
    **{f"F_a{i}": COSINE for i in range(10, 14)},
}
# Steps after the lead-in; the published scheme's work grows with their square.
_FIRST_STEPS = 1 << 10
_MOST_STEPS = {"modal": 1 << 20, "discrete_gradient": 1 << 20, "thesis2008": 1 << 14}


@lru_cache(maxsize=16)
def uncontrolled_force_n(scene: Scene) -> np.ndarray:
    """Contact force F_c0 of the first impact without control, from the sample at its start.

    In the published scheme its elastic part, as there; shape (samples in contact,). Raises
    SceneError when the contact lasts longer than is worth following.
    """
    from hertzloop.compiled import simulate
    from hertzloop.impact_rows import first_impact

    free, lead_s = scene.without_control(), scene.run.lead_in_s
    steps = _FIRST_STEPS
    while steps <= _MOST_STEPS[scene.run.scheme]:
        lasts = {"duration_s": lead_s + steps * scene.step_s}
        short = free.model_copy(update={"run": free.run.model_copy(update=lasts)})
        impact = first_impact(short, simulate(short).rows)
        if impact is not None and impact.ended:
            return impact.contact_n
        steps *= 4
    raise SceneError(
        "controller.law = 'precomputed' needs the contact force without control, but the first "
        f"contact does not end within {steps / 4 * scene.step_s:g} s; take a harder plate, less "
        "contact.viscous_n_s_m, or another law"
    )


def force_n(scene: Scene) -> tuple[float, ...]:
    """The scene's pre-computed force (N), one value a sample from the contact's start on."""
    control, every = scene.controller, scene.sensors.every_steps
    if control.precomputed == "F_mobility":
        force = control.kappa * mobility_force_n(scene)
    else:
        force = shaped(SHAPES[control.precomputed], control.kappa, uncontrolled_force_n(scene))
    return tuple(float(f) for f in force[::every])


def shaped(shape: str, kappa: float, contact_n: np.ndarray) -> np.ndarray:
    """kappa max(F_c0), or kappa F_c0 times 1, sin or cos of 2 pi t/T0; as long as F_c0.

    A constant force lasts as long as F_c0, too: without an end, kappa = 1 and 2 would never
    let the published impact end.
    """
    if shape == CONSTANT:
        return np.full(len(contact_n), kappa * float(contact_n.max()))
    phase = 2.0 * np.pi * np.arange(len(contact_n)) / len(contact_n)
    windows = {CONTACT_FORCE: np.ones(len(phase)), SINE: np.sin(phase), COSINE: np.cos(phase)}
    window = windows[shape]
    return np.asarray(kappa * contact_n * window)


def mobility_force_n(scene: Scene) -> np.ndarray:
    """Contact force of a simplified mobility model of the impact; shape (steps,), N.

    Our derivation of the idea of appendix A.1, whose own formula is not at hand: sphere of mass
    m, Hertz contact as a spring s_l of the same contact time on a rigid plate, plate as the
    point impedance Z = 8 sqrt(B' m'') of an infinite one:
    F'' + (s_l/Z) F' + (s_l/m) F = 0, F(0) = 0, F'(0) = s_l v0; until F returns to zero, or,
    overdamped, falls below 1e-3 of its peak.
    """
    from hertzloop import parts

    spec = parts.plant_spec(scene)
    m, v = spec.sphere.mass_kg, spec.sphere.impact_speed_m_s
    contact_s = rigid_contact_time_s(m, spec.contact.stiffness, v)
    spring = m * (np.pi / contact_s) ** 2
    decay = 0.5 * spring / spec.plate.infinite_plate_impedance_n_s_m
    squared = spring / m - decay * decay
    root = np.sqrt(abs(squared))
    if squared > 0.0:
        t = np.arange(int(np.pi / root / scene.step_s) + 1) * scene.step_s
        return np.asarray(spring * v / root * np.exp(-decay * t) * np.sin(root * t))
    slow = decay - root  # of the two decays; the quick one is over long before
    t = np.arange(int(np.log(1e3) / slow / scene.step_s) + 1) * scene.step_s
    if root == 0.0:
        return np.asarray(spring * v * t * np.exp(-decay * t))
    return np.asarray(spring * v / (2.0 * root) * (np.exp(-slow * t) - np.exp(-(decay + root) * t)))
