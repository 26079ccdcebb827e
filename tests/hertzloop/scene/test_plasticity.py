"""A contact that yields, as a scene: metrics of the 3 mm ball, the dent, and what "auto" means."""

import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import impacts_in
from hertzloop.plant.time_series import XI
from hertzloop.results.cases import metrics_of_case
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import Setup, load
from hertzloop.views.details import pressure_words
from tests.hertzloop.scenes import aluminium_3mm, recorded


def yielding(pressure_pa: float, *settings: str) -> Setup:
    law = ["contact.plasticity=thornton", f"contact.limiting_pressure_pa={pressure_pa}"]
    return aluminium_3mm("run.duration_s=0.0013", *law, *settings)


# Peak force (N), contact time (us), rebound (m/s), plate energy, dissipated (uJ), dent (um), and
# the plate energy of the law at -0.6 m/s against none (dB): from an independent solver.
@pytest.mark.full
@pytest.mark.parametrize(
    ("pressure_pa", "peak_n", "contact_us", "rebound", "plate_uj", "lost_uj", "dent_um", "law_db"),
    [
        (1.05e9, 74.26, 30.49, 0.45374, 235.5, 106.4, 2.38, 0.84),
        (0.77e9, 65.60, 32.16, 0.38267, 198.5, 169.7, 4.59, 4.25),
        (0.44e9, 51.82, 36.56, 0.27298, 144.9, 255.1, 9.31, None),
    ],
)
def test_the_3_mm_ball_on_a_plate_that_yields(
    pressure_pa, peak_n, contact_us, rebound, plate_uj, lost_uj, dent_um, law_db
):
    scene = yielding(pressure_pa, "controller.law=off")
    run = simulate(scene)
    (impact,) = impacts_in(scene.plant, run.truth)
    assert impact.peak_force_n == pytest.approx(peak_n, abs=0.006)
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


@pytest.mark.full
def test_contact_ends_at_the_dent_and_the_gap_shows_it(tmp_path):
    scene = yielding(0.44e9, "controller.law=off")
    recording = recorded(scene, tmp_path / "a.mcap")
    rows = truth_of(recording)
    (impact,) = impacts_in(scene.plant, rows)
    events = [e for e in recording.events if e.name == "plant"]
    assert [e.message for e in events] == ["contact 1 began", "contact 1 ended"]
    ended = round(events[1].time_ns / scene.run.step_ns)
    # The sphere has left the plate while its lowest point is still below the plate's face.
    assert impact.start_s + impact.duration_s == pytest.approx(ended * 1e-6, abs=1e-6)
    assert rows[XI, ended] < -5e-6


@pytest.mark.parametrize(
    ("settings", "gigapascal", "words"),
    [
        ([], 1.05, "1.05 GPa: 1 times the hardness of the plate, 1.05 GPa, known to 20 %"),
        (["plate.material=bearing_steel", "sphere.material=brass"], 1.1, "of the sphere"),
        (["plate.material=bearing_steel"], 7.0, "hardness of the plate, 7 GPa, known to 10 %"),
        (["contact.limiting_pressure_pa=0.5e9"], 0.5, "500 MPa, as the scene says"),
    ],
)
def test_the_limiting_pressure_comes_from_the_softer_body(settings, gigapascal, words):
    scene = aluminium_3mm("contact.plasticity=thornton", *settings)
    limit = scene.plant.contact.limit
    assert limit.pressure_pa == pytest.approx(gigapascal * 1e9)
    assert words in pressure_words(scene)


AUTO = "contact.plasticity=auto"
UNKNOWN = "plate.material={young_pa=7e10,density_kg_m3=2700,poisson=0.3}"


def test_auto_yields_as_thornton_does_where_the_pressure_passes_first_yield():
    auto, asked = aluminium_3mm(AUTO), aluminium_3mm("contact.plasticity=thornton")
    assert auto.mechanics.contact == asked.mechanics.contact
    assert auto.mechanics.contact.limit is not None
    assert auto.plate_model == asked.plate_model == "modal"
    assert auto.mechanics.why_elastic == ""
    given = aluminium_3mm(AUTO, "contact.limiting_pressure_pa=5e9", UNKNOWN)
    assert given.mechanics.contact.limit.pressure_pa == 5e9


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (["sphere.drop_height_m=1e-6"], "would begin to yield at 0.442 GPa, and the impact"),
        ([UNKNOWN], "the yield strength of the plate is not known"),
        (["contact.damping=hunt_crossley", "contact.restitution=0.7"], "holds the loss"),
        (["run.plate_model=infinite"], "knows no contact that yields"),
        (["run.scheme=thesis2008", "run.duration_s=0.002"], "knows no contact that yields"),
    ],
)
def test_auto_is_elastic_elsewhere_and_says_why(settings, reason):
    setup = aluminium_3mm(AUTO, *settings)
    assert setup.mechanics.contact == aluminium_3mm(*settings).mechanics.contact
    assert setup.mechanics.contact.limit is None
    assert reason in setup.mechanics.why_elastic


def test_the_published_scenes_are_elastic_and_say_so():
    for name in ("thesis-aluminium", "thesis-oak", "thesis-sylomer"):
        assert load(name).scene.contact.plasticity == "none"


def test_a_shipped_scene_takes_losses_that_a_setting_gives(shipped_scenes, tmp_path):
    """The loss factor of the mounted plate makes way."""
    assert aluminium_3mm().scene.plate.loss_factor == 0.02
    of_material = aluminium_3mm("plate.material.loss_factor=0.003").scene.plate
    assert (of_material.loss_factor, of_material.material.loss_factor) == (None, 0.003)
    file = tmp_path / "modes.csv"
    file.write_text("frequency_hz,loss_factor,modal_mass_kg,shape_contact\n100,0.01,1,1\n")
    modes = aluminium_3mm(f"plate.modes={file}", "plate.residual_flexibility_m_n=1e-8")
    assert modes.scene.plate.loss_factor is None


def test_shipped_plates_of_aluminium_yield(shipped_scenes):
    for name in ("aluminium-20mm", "aluminium-3mm", "offcentre-6mm"):
        assert load(name).mechanics.contact.limit is not None
    for name in ("oak-20mm", "sylomer-20mm"):
        assert "holds the loss" in load(name).mechanics.why_elastic
