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
