"""A contact that yields, as a scene: metrics of the 3 mm ball, what is recorded and refused."""

from pathlib import Path

import numpy as np
import pytest

import hertzloop
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.time_series import DEEPEST, XI
from hertzloop.recordings.reader import read
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.model import limiting_pressure
from hertzloop.results.recorded import truth_of
from hertzloop.results.verification import verify
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from hertzloop.views.details import pressure_words
from tests.commands import run_and_inspected

# These need a kind of plant of their own, whose kernels take half a minute to compile.
pytestmark = pytest.mark.full


def yielding(pressure_pa: float, *settings: str) -> Setup:
    law = ["contact.plasticity=thornton", f"contact.limiting_pressure_pa={pressure_pa}"]
    return load("aluminium-3mm", ["run.duration_s=0.0013", *law, *settings])


# Contact time (us), rebound (m/s), plate energy, dissipated (uJ), dent (um), and the plate energy
# of the law at -0.6 m/s against none (dB): from an independent solver.
@pytest.mark.parametrize(
    ("pressure_pa", "contact_us", "rebound", "plate_uj", "lost_uj", "dent_um", "law_db"),
    [
        (1.05e9, 30.49, 0.45374, 235.5, 106.4, 2.38, 0.84),
        (0.77e9, 32.16, 0.38267, 198.5, 169.7, 4.59, 4.25),
        (0.44e9, 36.56, 0.27298, 144.9, 255.1, 9.31, None),
    ],
)
def test_the_3_mm_ball_on_a_plate_that_yields(
    pressure_pa: float, contact_us: float, rebound: float, plate_uj: float, lost_uj: float,
    dent_um: float, law_db: float | None,
) -> None:  # fmt: skip
    scene = yielding(pressure_pa, "controller.law=off")
    run = simulate(scene)
    (impact,) = impacts_in(scene.plant, run.truth)
    assert 1e6 * impact.duration_s == pytest.approx(contact_us, abs=0.02)
    assert impact.rebound_speed_m_s == pytest.approx(rebound, rel=1e-3)
    assert 1e6 * impact.plate_energy_j == pytest.approx(plate_uj, rel=1e-3)
    assert 1e6 * run.balance.plastic_dissipated_j == pytest.approx(lost_uj, rel=1e-3)
    assert 1e6 * run.balance.dent_m == pytest.approx(dent_um, abs=0.01)
    balance = run.balance
    assert impact.plate_energy_j == pytest.approx(
        balance.modal_j + balance.modal_dissipated_j, rel=1e-4
    )
    if law_db is not None:
        found = metrics_of_case(yielding(pressure_pa, "controller.v_thr_m_s=-0.6"))
        assert found.plate_energy_db == pytest.approx(law_db, abs=0.02)


def test_contact_ends_at_the_dent_and_the_gap_shows_it(tmp_path: Path) -> None:
    scene = yielding(0.44e9, "controller.law=off")
    record_in_process(scene, tmp_path / "a.mcap", compiled=True)
    recording = read(tmp_path / "a.mcap")
    rows = truth_of(recording)
    assert np.array_equal(rows[DEEPEST], simulate(scene).truth[DEEPEST])
    (impact,) = impacts_in(scene.plant, rows)
    events = [e for e in recording.events if e.name == "plant"]
    assert [e.message for e in events] == ["contact 1 began", "contact 1 ended"]
    ended = round(events[1].time_ns / scene.step_ns)
    # The sphere has left the plate while its lowest point is still below the plate's face.
    assert impact.start_s + impact.duration_s == pytest.approx(ended * 1e-6, abs=1e-6)
    assert rows[XI, ended] < -5e-6


def test_run_inspect_and_python_tell_the_dent(tmp_path: Path) -> None:
    scene = yielding(1.05e9, "actuator.bandwidth_hz=3e5")
    keys = ["contact.plasticity=thornton", "contact.limiting_pressure_pa=1.05e9",
            "run.duration_s=0.0013", "actuator.bandwidth_hz=3e5"]  # fmt: skip
    (ran, written), (inspected, again) = run_and_inspected(tmp_path, *keys)
    assert "a dent of" in ran
    assert "a dent of" in inspected
    assert written["yield"] == again["yield"]
    dent_m = written["yield"]["dent_m"]
    assert dent_m > 2e-6
    assert float(hertzloop.simulate(scene.scene).truth["deepest_m"].max()) > dent_m


def test_verify_a_contact_that_yields() -> None:
    scene = yielding(1.05e9, "controller.v_thr_m_s=-0.6")
    run = simulate(scene)
    found = verify(scene, run.truth)
    assert found is not None
    assert found.rebound_speed < 1e-3
    assert found.penetration < 1e-3


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["contact.plasticity=thornton", "plate.material=sylomer_m"],
         "the yield pressure of plate.material = 'sylomer_m' is unknown. Give "
         "plate.material.yield_pa"),
        (["contact.plasticity=thornton", "sphere.material=bearing_steel",
          "plate.material={young_pa=7e10, density_kg_m3=2700, poisson=0.3}"],
         "the yield pressure of the plate's material is unknown. Give"),
        (["contact.plasticity=thornton", "contact.limiting_pressure_pa=1e9",
          "run.scheme=thesis2008"], "use the scheme 'modal'"),
        (["contact.plasticity=thornton", "contact.limiting_pressure_pa=1e9",
          "run.plate_model=infinite"], "plate_model = 'auto'"),
    ],
)  # fmt: skip
def test_what_is_refused(settings: list[str], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        load("aluminium-3mm", settings)


@pytest.mark.parametrize(
    ("settings", "gigapascal", "words"),
    [
        ([], 1.05, "1.05 GPa: 1 times the hardness of the plate, 1.05 GPa, known to 20 %"),
        (["plate.material=bearing_steel", "sphere.material=brass"], 1.1, "of the sphere"),
        (["plate.material=bearing_steel"], 7.0, "hardness of the plate, 7 GPa, known to 10 %"),
        (["contact.limiting_pressure_pa=0.5e9"], 0.5, "0.5 GPa, as the scene says"),
    ],
)
def test_the_limiting_pressure_comes_from_the_softer_body(
    settings: list[str], gigapascal: float, words: str
) -> None:
    scene = load("aluminium-3mm", ["contact.plasticity=thornton", *settings])
    limit = scene.plant.contact.limit
    assert limit is not None
    assert limit.pressure_pa == pytest.approx(gigapascal * 1e9)
    found = limiting_pressure(scene)
    assert found is not None
    assert words in pressure_words(found)
