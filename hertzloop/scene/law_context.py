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
from hertzloop.scene.mechanics import Mechanics
from hertzloop.sensors.acquisition import SensorSpec


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
    return law.force_bound(table.keys)


def resolve_law_context(
    mechanics: Mechanics, stiffness: float, path: SignalPath, sensor: SensorSpec, step_ns: int
) -> LawContext:
    """What a law may know without a simulation; `stiffness` of the contact, N/m^1.5."""
    local, limit_n, rigid = mechanics.structure.local_plate, path.full_scale_n, mechanics.rigid
    if stiffness != mechanics.contact.stiffness:
        contact = replace(mechanics.contact, stiffness=stiffness)
        rigid = rigid_impact(mechanics.sphere, contact)
    return LawContext(
        step_ns=step_ns,
        every_steps=sensor.every_steps,
        # The force of a sample acts one step after it at the earliest.
        loop_delay_steps=1 + path.latency_steps,
        stiffness=stiffness,
        sphere_mass_kg=mechanics.sphere.mass_kg,
        impact_speed_m_s=mechanics.sphere.impact_speed_m_s,
        impedance_n_s_m=local.infinite_plate_impedance_n_s_m if local else math.nan,
        rigid_contact_s=rigid.contact_s,
        rigid_peak_n=rigid.peak_n,
        converter_step=sensor.converter_step,
        limit_n=math.inf if limit_n is None else limit_n,
        yield_depth_m=yield_depth_m(mechanics.contact),
    )
