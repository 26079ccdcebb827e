"""Keys that cannot be, and keys that exclude each other: one sentence, before anything runs. Pairs
of features that the documentation lists are in test_combinations.
"""

import numpy as np
import pytest

from hertzloop.scene.controller import check_buildable
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load

YIELDS = "contact.plasticity=thornton"
HUGE = "run.plate_model=modal plate.size_m=[20.0,20.0]"
OTHER = "plate.material={young_pa=7e10,density_kg_m3=2700,poisson=0.3}"

# Settings of a scene, apart by spaces, and words of the sentence.
REFUSED = {
    "aluminium-20mm": {
        "sphere.radius_m=-1": "sphere.radius_m = -1: is not possible. Possible values: 1e-5 to 1",
        "sphere.radius_m=3mm": "sphere.radius_m = '3mm': is not possible",
        "sphere.radius_m=true": "sphere.radius_m = True: is not possible",
        "sphere.radius_m='0.003'": "sphere.radius_m = '0.003': is not possible",
        "plate.size_m=[true,0.5]": "plate.size_m = [True, 0.5]: is not possible",
        "sensors.bits=true": "sensors.bits = True: is not possible",
        "controller.kappa=true": "controller.kappa = True: is not possible",
        "sphere.radius_m.x=3": "sphere.radius_m.x",
        "plate.size_m=0.5": "plate.size_m = 0.5",
        "plate.size_m=[0.5]": "plate.size_m = [0.5]: is not possible. Possible values: 2 numbers, ",
        "plate.size_m=[0.5,0.5,0.5]": "plate.size_m = [0.5, 0.5, 0.5]: is not possible",
        "controller.latency_trace=none.csv": "'none.csv': cannot be read: there is no such file",
        "plate.contact_point_m=[0.5,0.25]": "plate.contact_point_m = [0.5, 0.25]: lies outside",
        "plate.actuator_point_m=[-0.1,0.25]": "plate.actuator_point_m = [-0.1, 0.25]: lies outside",
        "sensors.quantity=v_p": "sensors.quantity = 'v_p'",
        "sensors.full_scale=[1.0,-1.0]": "sensors.full_scale",
        "controller.law=pid": "controller.law = 'pid'",
        "controller.law=profile": "controller.profile_n is empty",
        "controller.law=constant": "controller.duration_us = 0",
        "controller.latency_us=1.5": "controller.latency_us = 1.5",
        "controller.bits=8": "controller.full_scale_n",
        "controller.kapa=1": "controller.kapa: unknown scene key. Did you mean kappa?",
        "contoller.kappa=1": "contoller",
        "run.duration_s=1e-10": "0 steps",
        "run.duration_s=1e9": "run.duration_s",
        "name=../../etc/passwd": "name",
        "kappa": "table.key=value",
    },
    "aluminium-3mm": {
        "plate.material=cheese": "plate.material = 'cheese': unknown material. Use one of steel",
        "sphere.material.density_kg_m3=-7800": "sphere.material.density_kg_m3 = -7800",
        "plate.material.young_pa=nan": "plate.material.young_pa = nan: must be",
        "plate.material.young_pa=72": "plate.material.young_pa = 72: must be 1e3",
        "plate.material.young_pa=72000": "make a speed of sound of 5.16 m/s",
        "plate.material.colour=3": "plate.material.colour is not a property of a material",
        "plate.material={young_pa=1e11}": "plate.material.density_kg_m3 is missing",
        "materials=none.toml": "materials = 'none.toml': cannot be read",
        "plate.modes=none.csv": "plate.modes = 'none.csv': cannot be read: there is no such file",
        "plate.modes=none.txt": "unknown format. Use a file that ends in .csv, .npz",
        "plate.residual_flexibility_m_n=1e-9": "or set plate.modes.",
        "plate.edges=ccc": "plate.edges = 'ccc': must be four letters, for the edges",
        "sensors.bits=12.5": 'Possible values: whole number or "ideal", 1 to 24.',
        "contact.damping=oil": 'Possible values: "none", "viscous", "hunt_crossley", "relax',
        # Edges, theory, and the modes that are truncated.
        "plate.edges=cfff plate.contact_point_m=[1e-6,0.2]": "lies on a supported edge",
        "plate.edges=ssss plate.contact_point_m=[1e-6,0.2]": "lies on a supported edge",
        "plate.theory=3d": "plate.theory = '3d': is not possible",
        "plate.tail=damped actuator.mass_kg=1e-3": "plate.tail = 'damped': not supported with",
        "plate.tail=damped run.scheme=thesis2008": "plate.tail = 'damped': not supported by",
        "run.plate_model=modal plate.size_m=[7.6,20.0] plate.thickness_m=0.017 "
        "actuator.mass_kg=0.01": "on about 3.5e+05 modes",
        f"{HUGE} plate.thickness_m=1e-4": "thicker plate",
        "plate.contact_point_m=[0.25,1e-10]": "plate.contact_point_m",
        "plate.thickness_m=1.0 plate.size_m=[0.01,0.01] plate.contact_point_m=[0.005,0.005]":
        "lowest mode",
        # The contact, the infinite plate and the published scheme.
        "contact.damping=relaxation run.plate_model=infinite": "relaxation",
        f"{YIELDS} plate.material=sylomer_m": "the yield pressure of plate.material = 'sylomer_m' "
        "is unknown. Give plate.material.yield_pa",
        f"{YIELDS} sphere.material=bearing_steel {OTHER}":
        "the yield pressure of the plate's material is unknown. Give",
        f"{YIELDS} run.scheme=thesis2008": "use the scheme 'modal'",
        f"{YIELDS} run.plate_model=infinite": "plate_model = 'auto'",
        "run.touch_phase=1.5": "run.touch_phase = 1.5: is not possible",
        "run.touch_phase=late": "run.touch_phase = 'late': is not possible",
        "run.touch_phase=0.2 run.lead_in_s=0": "the run must begin in flight",
        "run.touch_phase=random run.lead_in_s=0.3": "less than the time to the contact, 0.101 s",
        "run.touch_phase=0.2 run.scheme=thesis2008 run.duration_s=0.01":
        "not supported by run.scheme = 'thesis2008'",
        # Sensor, clock and actuator.
        "sensors.point_m=[0.31,0.22] sensors.quantity=xi controller.law=off":
        "sensors.quantity = 'xi' is one of the contact",
        "sensors.point_m=[0.6,0.1] sensors.quantity=v_p controller.law=off":
        "sensors.point_m = [0.6, 0.1]: lies outside the plate",
        "sensors.fault=offset": "needs sensors.fault_size",
        "sensors.fault_size=1": "has no effect without sensors.fault. Leave",
        "controller.clock_ppm=1e6": "controller.clock_ppm",
        "controller.clock_phase=1": "controller.clock_phase",
        "controller.clock_phase=-0.1": "controller.clock_phase",
        "actuator.dead_time_us=0.5": "whole number of steps",
        "actuator.bandwidth_hz=0": "actuator.bandwidth_hz = 0: is not possible",
        "actuator.mass_kg=-1": "actuator.mass_kg = -1: is not possible",
        "actuator.stroke_m=1": "actuator.stroke_m: unknown scene key",
        "actuator.mass_kg=0.001 plate.edges=ffff": "is not supported for a free plate",
        "actuator.mass_kg=0.001 run.scheme=thesis2008": "use the scheme 'modal'",
        "actuator.bandwidth_hz=1e5 run.plate_model=infinite": "plate_model = 'auto'",
        "controller.latency_trace={column=3}": "controller.latency_trace.file: is missing",
        "controller.latency_trace=[-1]": "latency_trace",
        "controller.latency_trace=[1] controller.latency_us=2": "has no effect beside",
        "controller.latency_trace=[1] controller.clock_ppm=2": "must not count twice",
        "controller.latency_trace=[1] controller.latency_trace_from=sample "
        "controller.clock_phase=0.5": "must not count twice",
        "controller.latency_trace={median_us=3}": "latency_trace.median_us: unknown scene key",
    },
    "offcentre-6mm": {"run.plate_model=infinite": "plate.actuator_point_m = [0.155, 0.09]"},
    "thesis-oak": {
        "run.plate_model=infinite contact.damping=none": "use the scheme 'modal'",
    },
    "thesis-aluminium": {
        "contact.viscous_n_s_m=1e9": "contact.viscous_n_s_m",
    },
}  # fmt: skip


CASES = [(name, *case) for name, cases in REFUSED.items() for case in cases.items()]


@pytest.mark.parametrize(("name", "settings", "words"), CASES)
def test_refused_with_a_sentence(name, settings, words):
    with pytest.raises(SceneError) as caught:
        check_buildable(load(name, settings.split()))
    said = str(caught.value)
    assert words in said
    assert "\n" not in said
    assert len(said) < 700


@pytest.mark.parametrize("seed", ["3", np.str_("3"), True], ids=["text", "of NumPy", "bool"])
def test_text_and_bool_are_no_numbers(seed):
    with pytest.raises(SceneError, match=r"run\.seed = .*: is not possible"):
        load("aluminium-3mm").vary({"run.seed": seed})
