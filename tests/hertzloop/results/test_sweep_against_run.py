"""A sweep's case sees the first impact that a run sees, bit by bit, whatever keys a scene has.

A case ends as soon as nothing later can belong to its first impact; a run goes on.
"""

from typing import Any

import numpy as np
import pytest

from hertzloop.controller.loading.registry import shipped
from hertzloop.loop.simulate import simulate
from hertzloop.results.impacts import first_impact, impacts_of
from hertzloop.results.span_metrics import of_impact
from hertzloop.results.spans import follow
from hertzloop.scene.setup import load
from tests.tiers import default

# Scenes whose cases ended too early once, or whose metrics differed.
ENDED_EARLY = [
    "oak-20mm sensors.ac_coupling_hz=5000 run.duration_s=0.02",
    "aluminium-3mm sensors.fault=offset sensors.fault_start_s=0.0014 sensors.fault_size=-1e-3",
    "offcentre-6mm sensors.bits=16 sensors.low_pass_hz=3000 sensors.low_pass_order=4 "
    "controller.law=constant controller.force_n=-20 controller.duration_us=5 run.accuracy=0.01 "
    "run.duration_s=0.006",
    "aluminium-3mm sensors.fault=spikes sensors.fault_size=-1e-3 sensors.fault_probability=0.001",
    "aluminium-3mm sensors.resonance_hz=2000",
    # The actuator pushes until the next contact.
    "offcentre-6mm sensors.fault=saturation sensors.fault_size=1e-6 sphere.drop_height_m=1e-5 "
    "actuator.bandwidth_hz=2000 run.duration_s=0.02",
]
# Keys of plant, line and touch that move the end of an impact.
PLANTS = [
    "contact.plasticity=thornton contact.limiting_pressure_pa=3e8",
    "contact.damping=hunt_crossley contact.restitution=0.3 run.lead_in_s=0.0002",
    "actuator.bandwidth_hz=2e4 actuator.damping=0.1 actuator.dead_time_us=400",
    "run.plate_model=modal run.touch_phase=random run.step_ns=500 controller.slew_n_s=1e6",
    "sphere.speed_m_s=0.1 actuator.stuck_from_s=1.01e-3 controller.latency_us=200",
]
OTHER_PLANTS = [
    "run.plate_model=infinite",
    "contact.damping=viscous contact.viscous_n_s_m=10",
    "actuator.bandwidth_hz=2e4 actuator.force_limit_n=30",
    "actuator.mass_kg=0.02",
    "plate.actuator_point_m=[0.2,0.12]",
    "sensors.point_m=[0.15,0.1] controller.law=velocity_feedback",
    "plate.edges=cfcf run.accuracy=0.05",
    "plate.tail=spring run.plate_model=modal",
]
LINE = (
    "aluminium-3mm sensors.every_steps=3 sensors.bits=12 sensors.noise_rms=1e-7 "
    "sensors.low_pass_hz=1e5 controller.latency_us=10 controller.jitter_us=5 "
    "controller.drop_out_probability=0.2 controller.clock_ppm=-200"
)
OF_LAW = {
    "constant": "controller.force_n=20 controller.duration_us=400 controller.delay_us=150",
    "profile": "controller.profile_n=[5.0,0.0,-5.0,20.0]",
    "linear": "controller.numerator=[-10.0,9.0] controller.denominator=[1.0,-0.999]",
}
LAWS = [f"{LINE} controller.law={law} {OF_LAW.get(law, '')}" for law in shipped()]
QUICK = [*ENDED_EARLY, *(f"aluminium-3mm {keys}" for keys in PLANTS), *LAWS]


def same_bits(a: Any, b: Any) -> bool:
    return np.asarray(a, float).tobytes() == np.asarray(b, float).tobytes()


def check(scene: str) -> None:
    """The first impact of a case is that of a run; a scene and its keys, apart by spaces."""
    name, *keys = scene.split()
    setup, case = follow(load(name, ["run.duration_s=0.003", *keys]), "impact")
    run = simulate(setup)
    assert same_bits(case.truth, run.truth[:, : case.truth.shape[1]])
    assert same_bits(case.values, run.values[: len(case.values)])
    found = first_impact(setup, case.truth)
    # As a report of the run has it, and as it is found in all steps.
    for expected in (
        impacts_of(setup, run.truth)[0],
        first_impact(setup, run.truth),
    ):
        assert (found.start, found.end, found.over) == (expected.start, expected.end, expected.over)
        wanted = vars(of_impact(setup.plant, expected))
        assert same_bits(list(vars(of_impact(setup.plant, found)).values()), list(wanted.values()))


@pytest.mark.parametrize(
    "scene", default([*QUICK, *(f"aluminium-3mm {keys}" for keys in OTHER_PLANTS)], QUICK)
)
def test_a_case_lasts_as_long_as_its_first_impact(scene):
    check(scene)
