"""A sensor beside the contact: against modes and simulations."""

import numpy as np
import pytest

from benchmarks.margin import beside_the_contact
from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.fit.impact_simulator import ImpactSimulator
from hertzloop.fitting.fit.problem_preparation import with_measuring_point
from hertzloop.fitting.records.record import Record
from hertzloop.plant.state_kernels import F_C, FLIGHT_V, FLIGHT_X, SENSOR_A, SENSOR_V, V_P
from hertzloop.plant.structures.mode_file import ModeTable, write_modes
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from tests.plant.rigs import after_steps

AT, BESIDE, THIRD = "[0.21,0.13]", "[0.31,0.22]", "[0.12,0.31]"
FLIGHT = ["run.lead_in_s=0.01", "controller.law=off", "sensors.quantity=v_p"]
SENSOR = f"sensors.point_m={BESIDE}"


def plate(*settings: str) -> Setup:
    return load("aluminium-3mm", [*FLIGHT, f"plate.contact_point_m={AT}", *settings])


def seen(setup: Setup, forces: np.ndarray) -> np.ndarray:
    """Velocity and acceleration that the state has where the sensor is, after every step."""
    return after_steps(build_plant(setup, flight=True), forces, [SENSOR_V, SENSOR_A]).T


def by_reciprocity(setup: Setup, forces: np.ndarray) -> np.ndarray:
    """The velocity at the contact of a plate that is struck where the sensor was."""
    turned = setup.vary(
        {
            "plate.contact_point_m": setup.scene.sensors.point_m,
            "plate.actuator_point_m": setup.scene.plate.points_m[1],
            "sensors.point_m": None,
        }
    )
    return after_steps(build_plant(turned, flight=True), forces, V_P)


FORCES = np.random.default_rng(4).standard_normal(300)


@pytest.mark.full
@pytest.mark.parametrize(
    "settings",
    [
        (f"plate.actuator_point_m={THIRD}",),
        ("actuator.bandwidth_hz=30000",),
    ],
)
def test_a_sensor_elsewhere_sees_what_the_contact_there_would_feel(settings):
    """Contact and sensor change places, and the actuator stays."""
    setup = plate(SENSOR, *settings)
    velocity, acceleration = seen(setup, FORCES)
    expected = by_reciprocity(setup, FORCES)
    assert np.abs(velocity - expected).max() < 1e-12 * np.abs(expected).max()
    rate = np.diff(velocity, prepend=0.0) / setup.run.step_s
    assert np.abs(acceleration - rate).max() < 1e-12 * np.abs(rate).max()


def table(with_sensor: bool) -> ModeTable:
    """Modes of the plate, as a file has them."""
    setup = plate(f"plate.actuator_point_m={BESIDE}")
    limit = 2.0 * np.pi * setup.plant.frequency_limit_hz
    contact, sensor = setup.scene.plate.points_m
    modes = setup.mechanics.structure.modes(limit, contact, sensor)
    return ModeTable(
        modes.omega,
        np.full(len(modes.omega), setup.mechanics.structure.local_plate.eta),
        np.full(len(modes.omega), modes.scale_per_kg),
        modes.at_contact,
        modes.at_contact,
        setup.mechanics.structure.residual_flexibility_m_n(limit, contact),
        shape_sensor=modes.at_actuator if with_sensor else None,
    )


@pytest.mark.full
def test_a_file_of_modes_says_where_the_sensor_is(tmp_path):
    (tmp_path / "modes.npz").write_bytes(write_modes(".npz", table(True)))
    (tmp_path / "bare.npz").write_bytes(write_modes(".npz", table(False)))
    tail = ["plate.tail=spring"]
    of_file = load("aluminium-3mm", [*FLIGHT, f"plate.modes={tmp_path / 'modes.npz'}", *tail])
    of_plate = plate(SENSOR, *tail)
    (velocity, _), (expected, _) = (seen(setup, FORCES) for setup in (of_file, of_plate))
    assert np.abs(velocity - expected).max() < 1e-12 * np.abs(expected).max()
    assert of_file.vary({"sensors.quantity": "contact_force"}).sensor.of_state == F_C
    bare = load("aluminium-3mm", [*FLIGHT, f"plate.modes={tmp_path / 'bare.npz'}", *tail])
    assert bare.sensor.of_state == V_P
    with pytest.raises(SceneError, match="Remove the key, and give the file a column shape_sensor"):
        of_file.vary({"sensors.point_m": [0.1, 0.1]})


def velocity_record(**measured: object) -> Record:
    time_s = np.arange(600) * 1e-6
    return Record("v.csv", time_s, np.sin(1e4 * time_s), "v_p", measured)


def test_a_record_is_taken_where_the_sensor_of_the_scene_is(tmp_path):
    setup = plate(SENSOR)
    assert with_measuring_point(velocity_record(), setup).measurement.point_m == (0.31, 0.22)
    assert with_measuring_point(velocity_record(point_m=(0.1, 0.2)), setup).measurement.point_m == (
        0.1,
        0.2,
    )
    assert with_measuring_point(velocity_record(), plate()).measurement.point_m is None
    force = Record("f.csv", np.arange(600) * 1e-6, np.ones(600), "contact_force")
    assert with_measuring_point(force, setup) is force
    heavy = plate(SENSOR, "actuator.mass_kg=0.01")
    with pytest.raises(RecordError, match=r"actuator.mass_kg = 0.01: not supported with v.csv"):
        with_measuring_point(velocity_record(), heavy)
    (tmp_path / "modes.npz").write_bytes(write_modes(".npz", table(True)))
    of_file = load("aluminium-3mm", [*FLIGHT, f"plate.modes={tmp_path / 'modes.npz'}"])
    with pytest.raises(RecordError, match=r"record.point_m = .*: the modes of modes.npz know no"):
        with_measuring_point(velocity_record(point_m=(0.1, 0.2)), of_file)
    assert with_measuring_point(velocity_record(), of_file).measurement.point_m is not None


@pytest.mark.full
@pytest.mark.parametrize("by_file", [False, True])
def test_a_frozen_model_has_the_motion_of_the_sensor(by_file, tmp_path):
    """What a fit compares records with, against the state where the sensor is."""
    settings = [
        "controller.law=off",
        "sensors.quantity=v_p",
        f"plate.contact_point_m={AT}",
        "run.duration_s=0.0015",
        "plate.tail=spring",
    ]
    if by_file:
        (tmp_path / "modes.npz").write_bytes(write_modes(".npz", table(True)))
        setup = load("aluminium-3mm", [*settings, f"plate.modes={tmp_path / 'modes.npz'}"])
    else:
        setup = load("aluminium-3mm", [*settings, SENSOR])
    point = with_measuring_point(velocity_record(), setup).measurement.point_m
    simulator = ImpactSimulator(setup, 5e-4, 1e-3, point)
    plant = build_plant(setup)
    seen_m_s = after_steps(plant, np.zeros(setup.run.steps), SENSOR_V)
    after_s = np.linspace(2e-5, 4e-4, 30)
    height, speed = plant.at_start().state.body[[FLIGHT_X, FLIGHT_V]]
    lead_s = (
        2.0 * height / (setup.mechanics.sphere.impact_speed_m_s - speed)
    )  # the mean of both speeds
    at = (after_s + lead_s) / setup.run.step_s - 1.0  # a value is that at the end of a step
    expected = np.interp(at, np.arange(setup.run.steps), seen_m_s)
    found = simulator.run({}, 4.5e-4).value("v_p", after_s, away_from_contact=True)
    assert np.abs(found - expected).max() < 0.01 * np.abs(expected).max()


@pytest.mark.full
def test_limits_of_loops_that_are_not_collocated_are_those_of_simulations():
    """Random loops: at the latency limit they do not grow, beyond it they do."""
    checks = list(beside_the_contact(8, 5))
    assert len(checks) >= 10
    assert [one for one in checks if not one.agrees] == []
