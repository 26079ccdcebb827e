"""From a checked scene to the controller: law with its constants, line."""

import math
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from controller.controller import Controller, LineSpec
from controller.door.bound import BoundLaw
from controller.door.law import LawError
from controller.door.registry import find, shipped
from controller.law import About, Keys
from hertzloop import assembly as parts
from hertzloop.loop import kernels as k
from hertzloop.loop.plant_streams import empty_window
from hertzloop.results.impact_rows import first_impact
from hertzloop.scenes.scene import Scene, SceneError
from hertzloop.scenes.shared import by_tables
from hertzloop.struck import impedance_n_s_m, structure
from plant.plant import PlantSpec

_TRIED_N_S_M = (100.0, 1000.0)  # impedances, to see whether a law takes any
# Steps after the lead-in; the published scheme's work grows with their square.
_FIRST_STEPS = 1 << 10
_MOST_STEPS, _MOST_PUBLISHED = 1 << 20, 1 << 14


def about(scene: Scene, stiffness: float) -> About:
    """What a law may know of a run; `stiffness` in N/m^1.5 is the contact's."""
    limits = parts.full_scale(scene) if scene.sensors.bits != "ideal" else None
    step = (limits[1] - limits[0]) / (2 ** int(scene.sensors.bits) - 1) if limits else 0.0
    return parts.about_bodies(
        scene,
        stiffness,
        converter_step=step,
        uncontrolled_force_n=partial(uncontrolled_force_n, scene),
    )


@by_tables(
    "sphere", "plate", "contact", "actuator", "materials", "sensors", "controller", "run.step_ns",
    "run.scheme", "run.plate_model", "run.accuracy", "run.lead_in_s", "run.touch_phase", "run.seed",
)  # fmt: skip
def law(scene: Scene, stiffness: float, ahead: bool = True) -> BoundLaw:
    """The scene's law with its constants; without `ahead` its commands alone, where nobody asks
    what it knows of samples to come. Raises SceneError."""
    known = about(scene, stiffness)
    try:
        if math.isnan(known.impedance_n_s_m) and _needs_impedance(scene, known):
            impedance_n_s_m(structure(scene))  # says what is missing
        return scene.law.bind(scene.controller.keys, known, ahead)
    except LawError as error:
        raise SceneError(str(error)) from error


def _needs_impedance(scene: Scene, known: About) -> bool:
    """Whether the law's constants follow from it: whether they differ for two of them."""
    if not hasattr(getattr(scene.law, "home", None), "prepare"):
        return False  # it has all that is known as it is
    one, other = (
        scene.law.constants(scene.controller.keys, replace(known, impedance_n_s_m=tried))
        for tried in _TRIED_N_S_M
    )
    return any(not np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def controller(scene: Scene, stiffness: float, ahead: bool = True) -> Controller:
    """The controller at the start of its run; `stiffness` in N/m^1.5 is the contact's, `ahead` as
    of `law`."""
    table = scene.controller
    line = LineSpec(
        latency_steps=scene.in_steps(table.latency_us),
        jitter_steps=scene.in_steps(table.jitter_us),
        drop_out_probability=table.drop_out_probability,
        bits=None if table.bits == "ideal" else int(table.bits),
        full_scale_n=table.full_scale_n,
        slew_n_s=table.slew_n_s,
    )
    every = scene.sensors.every_steps
    bound = law(scene, stiffness, ahead)
    return Controller(bound, line, scene.step_s, scene.steps, every, scene.run.seed)


def idle() -> Controller:
    """A controller without a law, whose kernels are loaded, or compiled, once it is there: before
    anybody waits for an answer."""
    found = Controller(find("off").bind(Keys(), About()), LineSpec(), 1e-6, 1, 1, 0)
    found.process(np.empty(0))
    return found


def flight_m(scene: Scene, spec: PlantSpec) -> float:
    """How far above the plate the scene's law has to see the sphere, m: what it flies in the
    latency and the law's window; zero of a law that waits for the contact, or is not shipped.
    Raises SceneError."""
    if scene.controller.law not in shipped():  # a recording must not have others called
        return 0.0
    level = law(scene, spec.contact.stiffness, True).waits_above
    if not 0.0 < level < math.inf:
        return 0.0
    known = parts.about_bodies(scene, spec.contact.stiffness)
    window = getattr(scene.controller.keys, "window_samples", 1) * known.sample_s
    return min(level, known.impact_speed_m_s * (known.horizon_s + window))


@lru_cache(maxsize=16)
def uncontrolled_force_n(scene: Scene) -> np.ndarray:
    """Contact force F_c0 of the first impact without control, from the sample at its start.

    In the published scheme its elastic part, as there; shape (samples in contact,). Raises
    LawError when the contact lasts longer than is worth following.
    """
    free, lead_s = scene.without_control(), scene.run.lead_in_s
    steps = _FIRST_STEPS
    published = scene.run.scheme == "thesis2008"
    while steps <= (_MOST_PUBLISHED if published else _MOST_STEPS):
        lasts = {"duration_s": lead_s + steps * scene.step_s}
        short = free.model_copy(update={"run": free.run.model_copy(update=lasts)})
        plant, window = parts.plant(short), empty_window(short.steps, 0)
        k.plant_alone(plant.model, plant.state, np.zeros(short.steps), window)
        impact = first_impact(short, window.truth)
        if impact is not None and impact.ended:
            return impact.contact_n
        steps *= 4
    raise LawError(
        f"controller.law = '{scene.controller.law}' needs the contact force without control, but "
        f"the first contact does not end within {steps / 4 * scene.step_s:g} s; take a harder "
        "plate, less contact.viscous_n_s_m, or another law"
    )
