"""The roofline measures what it says; how fast that is here is not for a test to judge."""

import pytest

from benchmarks import integrator_kernels as ik
from benchmarks import roofline
from benchmarks.costs import roofline_table
from hertzloop.plant.state_kernels import CONTACT_STEPS


@pytest.mark.full
def test_shares_name_what_was_measured() -> None:
    found = roofline.shares(rounds=2)
    assert [s.frequencies for s in found] == [1104] * 3 + [448] * 3 + [564] * 3
    for share in found:
        assert share.floor_us > 0.0
        assert share.pass_us > 0.0
        numbers = {"flight": 5, "contact": 9, "contact, booked": 16}
        held = numbers[share.case.rsplit(", ", 2)[0]]
        assert share.kilobytes == pytest.approx(8 * held * share.frequencies / 1024)
    rows = [vars(share) for share in found]
    assert roofline_table("roofline", rows).row_count == 9


@pytest.mark.parametrize("scene", roofline.SCENES)
def test_cases_are_in_contact_and_in_flight(scene: tuple[str, str, int, int]) -> None:
    """A case that left the contact while it is measured would flatter the step."""
    count = scene[3]
    for name, case in roofline.cases(*scene).items():
        state = case.state._replace(**{n: a.copy() for n, a in case.state._asdict().items()})
        before = state.counts[CONTACT_STEPS]
        ik.plant_steps(case.model, state, 0.0, count)
        steps = state.counts[CONTACT_STEPS] - before
        assert steps == (0 if name.startswith("flight") else count)
        assert abs(state.z).max() > 0.0  # the plate rings
        assert case.model.damped == ("booked" in name)
