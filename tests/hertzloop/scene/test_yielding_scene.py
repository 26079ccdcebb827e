"""A contact that yields, as a scene: metrics of the 3 mm ball, what is recorded and refused."""

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.time_series import XI
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.model import limiting_pressure
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import Setup
from hertzloop.views.details import pressure_words
from tests.hertzloop.scenes import aluminium_3mm, recorded

# These need a kind of plant of their own, whose kernels take half a minute to compile.
pytestmark = pytest.mark.full


def yielding(pressure_pa: float, *settings: str) -> Setup:
    law = ["contact.plasticity=thornton", f"contact.limiting_pressure_pa={pressure_pa}"]
    return aluminium_3mm("run.duration_s=0.0013", *law, *settings)


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
    pressure_pa, contact_us, rebound, plate_uj, lost_uj, dent_um, law_db
):
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


def test_contact_ends_at_the_dent_and_the_gap_shows_it(tmp_path):
    scene = yielding(0.44e9, "controller.law=off")
    recording = recorded(scene, tmp_path / "a.mcap")
    rows = truth_of(recording)
    (impact,) = impacts_in(scene.plant, rows)
    events = [e for e in recording.events if e.name == "plant"]
    assert [e.message for e in events] == ["contact 1 began", "contact 1 ended"]
    ended = round(events[1].time_ns / scene.step_ns)
    # The sphere has left the plate while its lowest point is still below the plate's face.
    assert impact.start_s + impact.duration_s == pytest.approx(ended * 1e-6, abs=1e-6)
    assert rows[XI, ended] < -5e-6


@pytest.mark.parametrize(
    ("settings", "gigapascal", "words"),
    [
        ([], 1.05, "1.05 GPa: 1 times the hardness of the plate, 1.05 GPa, known to 20 %"),
        (["plate.material=bearing_steel", "sphere.material=brass"], 1.1, "of the sphere"),
        (["plate.material=bearing_steel"], 7.0, "hardness of the plate, 7 GPa, known to 10 %"),
        (["contact.limiting_pressure_pa=0.5e9"], 0.5, "0.5 GPa, as the scene says"),
    ],
)
def test_the_limiting_pressure_comes_from_the_softer_body(settings, gigapascal, words):
    scene = aluminium_3mm("contact.plasticity=thornton", *settings)
    limit = scene.plant.contact.limit
    assert limit.pressure_pa == pytest.approx(gigapascal * 1e9)
    found = limiting_pressure(scene)
    assert words in pressure_words(found)
