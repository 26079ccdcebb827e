"""The actuator as a scene's table: what it costs the law, what is refused, what is printed."""

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.metrics import metrics_of
from hertzloop.scene.build import build_plant
from hertzloop.scene.errors import SceneError
from tests.hertzloop.scenes import aluminium_3mm, recorded

pytestmark = pytest.mark.full

EARLY = ["run.duration_s=0.0013", "controller.v_thr_m_s=-0.6"]


def plate_energy_db(latency_us: int, *settings: str) -> float:
    latency = f"controller.latency_us={latency_us}"
    return metrics_of_case(aluminium_3mm(*EARLY, latency, *settings)).plate_energy_db


def critical_us(*settings: str) -> float:
    """Latency at which the plate energy crosses that without control, interpolated, us."""
    before = plate_energy_db(0, *settings)
    for latency in range(1, 9):
        energy = plate_energy_db(latency, *settings)
        if energy > 0.0:
            return latency - energy / (energy - before)
        before = energy
    return float("inf")


# Plate energy without latency (dB), critical latency (us): from an independent solver.
@pytest.mark.parametrize(
    ("setting", "energy_db", "latency_us"),
    [
        ("actuator.bandwidth_hz=1e6", -1.36, 2.83),
        ("actuator.bandwidth_hz=1e5", -0.33, 0.81),
        ("actuator.mass_kg=3e-3", -2.94, 6.81),
    ],
)
def test_bandwidth_and_mass_cost_the_law_its_latency(setting, energy_db, latency_us):
    assert plate_energy_db(0, setting) == pytest.approx(energy_db, abs=0.02)
    assert critical_us(setting) == pytest.approx(latency_us, abs=0.03)


# Rebound (m/s) and work on plate and mass (uJ) without law: from an independent solver.
@pytest.mark.parametrize(
    ("mass_kg", "rebound_m_s", "work_uj"),
    [(1e-3, 0.5767, 286.0), (1e-2, 0.8534, 111.5)],
)
def test_a_mass_on_the_struck_point(mass_kg, rebound_m_s, work_uj):
    settings = ["run.duration_s=0.0013", "controller.law=off", f"actuator.mass_kg={mass_kg}"]
    scene = aluminium_3mm(*settings)
    (impact,) = impacts_in(scene.plant, simulate(scene).truth)
    assert impact.rebound_speed_m_s == pytest.approx(rebound_m_s, rel=1e-3)
    assert 1e6 * impact.plate_energy_j == pytest.approx(work_uj, rel=2e-3)


def test_the_recording_holds_the_force_and_the_command(tmp_path):
    scene = aluminium_3mm("run.duration_s=0.0013", "actuator.force_limit_n=12")
    recording = recorded(scene, tmp_path / "a.mcap")
    assert recording.force.arrays["force_n"].max() > 40.0
    assert recording.truth.arrays["f_a_n"].max() == 12.0
    assert "f_a1_n" not in recording.truth.arrays


def test_demand_of_the_ideal_law():
    scene = aluminium_3mm("run.duration_s=0.0013")
    asked = metrics_of(scene, simulate(scene).truth).demand
    assert 65.0 < asked.force_n < 75.0
    assert 5.0 < asked.power_w < 15.0
    assert asked.slew_n_s == pytest.approx(8.4e6, rel=0.05)
    assert asked.delay_s == 0.0
    off = aluminium_3mm("run.duration_s=0.0013", "controller.law=off")
    assert metrics_of(off, simulate(off).truth).demand is None


def test_a_mass_on_modes_with_losses_of_their_own_is_refused(tmp_path):
    rows = [f"{20000 + 8000 * i},{0.01 * (i + 1)},0.01,1.0" for i in range(12)]
    flexible = "# residual_flexibility_m_n = 1e-9"
    header = "frequency_hz,loss_factor,modal_mass_kg,shape_contact"
    (tmp_path / "m.csv").write_text("\n".join([flexible, flexible, header, *rows]))
    with pytest.raises(SceneError, match=r"actuator\.mass_kg = 0\.001 needs one loss factor"):
        build_plant(aluminium_3mm(f"plate.modes={tmp_path / 'm.csv'}", "actuator.mass_kg=0.001"))
