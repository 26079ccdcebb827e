"""What is known of a law before it is prepared, and what a law may know of a run."""

import math
from dataclasses import replace
from functools import lru_cache

from hertzloop.controller.controller import SignalPath
from hertzloop.controller.law import ForceBound, LawContext
from hertzloop.controller.loading.law import Law, LawError
from hertzloop.plant.contact.hertz import rigid_impact
from hertzloop.plant.contact.yielding import yield_depth_m
from hertzloop.scene.controller_table import ControllerTable
from hertzloop.scene.errors import SceneError
from hertzloop.scene.mechanics import Mechanics


def law_force_bound(table: ControllerTable) -> ForceBound:
    """How far the force of the law can go; without limit if the law is not there any more, as that
    of a recording may be. Raises SceneError."""
    try:
        law = table.loaded_law
    except LawError:
        return ForceBound()
    return _law_force_bound(table, law)


@lru_cache(maxsize=16)
def _law_force_bound(table: ControllerTable, law: Law) -> ForceBound:
    try:
        return law.force_bound(table.keys)
    except LawError as error:
        raise SceneError(str(error)) from error


@lru_cache(maxsize=16)
def about_impact(mechanics: Mechanics, s: float) -> LawContext:
    """What a law may know of the bodies alone, with the contact stiffness `s`, N/m^1.5."""
    m, v = mechanics.sphere.mass_kg, mechanics.sphere.impact_speed_m_s
    local = mechanics.structure.local_plate
    rigid = mechanics.rigid
    if s != mechanics.contact.stiffness:
        rigid = rigid_impact(mechanics.sphere, replace(mechanics.contact, stiffness=s))
    return LawContext(
        stiffness=s,
        sphere_mass_kg=m,
        impact_speed_m_s=v,
        impedance_n_s_m=local.infinite_plate_impedance_n_s_m if local else math.nan,
        rigid_contact_s=rigid.contact_s,
        rigid_peak_n=rigid.peak_n,
        yield_depth_m=yield_depth_m(mechanics.contact),
    )


@lru_cache(maxsize=16)
def about_mechanics(
    mechanics: Mechanics, stiffness: float, line: SignalPath, step_ns: int, every_steps: int
) -> LawContext:
    """What a law may know without a simulation and without the range of the converter."""
    limit_n = line.full_scale_n
    return replace(
        about_impact(mechanics, stiffness),
        step_ns=step_ns,
        every_steps=every_steps,
        # The force of a sample acts one step after it at the earliest.
        loop_delay_steps=1 + line.latency_steps,
        limit_n=math.inf if limit_n is None else limit_n,
    )
