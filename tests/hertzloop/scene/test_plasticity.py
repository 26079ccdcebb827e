"""`contact.plasticity = "auto"`: a contact yields where the impact would pass first yield."""

import pytest

from hertzloop.scene.setup import load
from tests.hertzloop.scenes import aluminium_3mm

AUTO = "contact.plasticity=auto"
GLASS = "plate.material=glass"
UNKNOWN = "plate.material={young_pa=7e10,density_kg_m3=2700,poisson=0.3}"


def test_auto_yields_as_thornton_does_where_the_pressure_passes_first_yield():
    auto, asked = aluminium_3mm(AUTO), aluminium_3mm("contact.plasticity=thornton")
    assert auto.contact == asked.contact
    assert auto.contact.limit is not None
    assert auto.plate_model == asked.plate_model == "modal"
    assert auto.mechanics.why_elastic == ""
    given = aluminium_3mm(AUTO, "contact.limiting_pressure_pa=5e9", UNKNOWN)
    assert given.contact.limit.pressure_pa == 5e9


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
    assert setup.contact == aluminium_3mm(*settings).contact
    assert setup.contact.limit is None
    assert reason in setup.mechanics.why_elastic


def test_a_slow_impact_on_a_hard_plate_is_decided_by_its_pressure():
    """Glass has a hardness: the threshold is 1.6/2.8 of it."""
    fast = aluminium_3mm(AUTO, GLASS, "sphere.material=alumina", "sphere.speed_m_s=5")
    slow = aluminium_3mm(AUTO, GLASS, "sphere.material=alumina", "sphere.speed_m_s=0.05")
    assert (fast.contact.limit is not None, slow.contact.limit is None) == (True, True)


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
        assert load(name).contact.limit is not None
    for name in ("oak-20mm", "sylomer-20mm"):
        assert "holds the loss" in load(name).mechanics.why_elastic
