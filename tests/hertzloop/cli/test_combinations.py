"""A sphere by mass and speed, and a sensor elsewhere, beside every other feature of a scene:
built, or refused with a remedy."""

import re

import pytest

from hertzloop.controller.law import LawError
from hertzloop.scene.controller import check_buildable
from hertzloop.scene.errors import SceneError
from tests.commands import succeed
from tests.hertzloop.scenes import aluminium_3mm

BY_SPEED, ELSEWHERE = "sphere by mass and speed", "sensor elsewhere"
# Settings of each feature on the scene aluminium-3mm. MODES stands for a file of modes.
FEATURES = {
    BY_SPEED: "sphere.mass_kg=0.02 sphere.speed_m_s=0.7",
    ELSEWHERE: "sensors.point_m=[0.31,0.22] sensors.quantity=v_p controller.law=velocity_feedback",
    "thesis2008": "run.scheme=thesis2008 run.duration_s=0.002",
    "infinite plate": "run.plate_model=infinite",
    "other edges": "plate.edges=cccf",
    "modes from a file": "plate.modes=MODES",
    "damped truncated modes": "plate.tail=damped",
    "contact that yields": "contact.plasticity=thornton",
    "contact damping": "contact.damping=hunt_crossley contact.restitution=0.7",
    "touch phase": "run.touch_phase=random",
    "actuator elsewhere": "plate.actuator_point_m=[0.2,0.2]",
    "actuator mass": "actuator.mass_kg=0.01",
    "actuator bandwidth": "actuator.bandwidth_hz=20000",
    "law predicted": "controller.law=predicted",
    "law force_feedback": "controller.law=force_feedback",
}
# What a sensor elsewhere excludes, as the page on sensors says.
REFUSED = {"thesis2008", "infinite plate", "modes from a file", "law predicted"}
REFUSED |= {"law force_feedback"}
QUICK = {"infinite plate", "modes from a file", BY_SPEED}


def pair(one: str, other: str):
    """A pair of features; pairs with many modes belong to `--all`."""
    slow = one == "other edges" or (other == ELSEWHERE and one not in QUICK)
    marks = [pytest.mark.full] if slow else []
    return pytest.param(one, other, marks=marks, id=re.sub(r"\W+", "-", f"{one}-{other}"))


PAIRS = [pair(ELSEWHERE, BY_SPEED)] + [
    pair(one, other) for one in [*FEATURES][2:] for other in (BY_SPEED, ELSEWHERE)
]


@pytest.fixture(scope="session")
def modes_file(tmp_path_factory):
    """Modes of the default plate, as a file."""
    path = tmp_path_factory.mktemp("combined") / "modes.csv"
    succeed("scene", "modes", "aluminium-3mm", "-o", path)
    return path


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_a_pair_of_features(one, other, modes_file):
    settings = f"{FEATURES[other]} {FEATURES[one]}".replace("MODES", str(modes_file)).split()
    if not (other == ELSEWHERE and one in REFUSED):
        check_buildable(aluminium_3mm("run.duration_s=0.002", *settings))
        return
    with pytest.raises((SceneError, LawError)) as found:
        check_buildable(aluminium_3mm("run.duration_s=0.002", *settings))
    # The sentence begins its remedy with a verb.
    remedy = r"\. (Use|Give|Remove|Leave|Choose|Set|Support|Add|Reduce)"
    assert re.search(remedy, str(found.value))
