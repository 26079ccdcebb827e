"""The contact law: Hertz, Thornton, and either in series with a spring."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hertzloop.plant.contact import yielding
from hertzloop.plant.contact.contact_kernels import (
    ContactModel,
    contact_law,
    in_series,
    unloading,
)
from hertzloop.plant.contact.hertz import Contact as Description
from hertzloop.plant.contact.hertz import Limit, hertz_stiffness
from hertzloop.plant.structures.materials import MATERIALS

RADIUS, PRESSURE = 0.003, 1.05e9
STIFFNESS = hertz_stiffness(RADIUS, MATERIALS["steel"], MATERIALS["aluminium"])
MODULUS = 0.75 * STIFFNESS / math.sqrt(RADIUS)
ELASTIC = ContactModel(STIFFNESS, math.inf, 0.0, 0.0, 0.0)
LIMITED = Description(STIFFNESS, limit=Limit(PRESSURE, RADIUS))
YIELDS = ELASTIC._replace(yield_m=yielding.yield_depth_m(LIMITED))
DEEPEST = np.array([1.0, 1.1, 3.0, 40.0]) * YIELDS.yield_m
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def law(contact: ContactModel, p: float, deepest: float) -> tuple[float, float, float]:
    """Force, slope and work."""
    found: tuple[float, float, float] = contact_law(contact, p, unloading(contact, deepest))
    return found


def force(contact: ContactModel, penetrations: np.ndarray, deepest: float) -> np.ndarray:
    return np.array([law(contact, p, deepest)[0] for p in penetrations])


def work_j(contact: ContactModel, begin: float, end: float, deepest: float) -> float:
    """Integral of the force over the penetration from where it is zero or has a corner."""
    u = 0.5 * (NODES + 1.0)  # p = begin + (end - begin) u^2 smooths the power 3/2
    values = force(contact, begin + (end - begin) * u * u, deepest)
    return float(np.sum(WEIGHTS * u * values) * (end - begin))


def test_an_elastic_contact_is_hertz():
    p = np.array([-1e-6, 0.0, 1e-9, 3e-6])
    for deepest in (0.0, 1e-5):
        found = force(ELASTIC, p, deepest)
        assert found == pytest.approx(STIFFNESS * np.maximum(p, 0.0) ** 1.5, rel=1e-14)
    _, slope, work = law(ELASTIC, 3e-6, 0.0)
    assert slope == pytest.approx(1.5 * STIFFNESS * math.sqrt(3e-6), rel=1e-14)
    assert work == pytest.approx(0.4 * STIFFNESS * 3e-6**2.5, rel=1e-14)
    curve = unloading(ELASTIC, 1e-5)
    assert curve.dent == curve.lost == 0.0


def test_a_contact_that_yields_is_thorntons():
    """Against his formulas, and against those that the metrics use."""
    at_yield, deepest = YIELDS.yield_m, DEEPEST[1:]
    assert at_yield == pytest.approx(RADIUS * (math.pi * PRESSURE / (2.0 * MODULUS)) ** 2)
    first = STIFFNESS * at_yield**1.5
    load = first + math.pi * PRESSURE * RADIUS * (deepest - at_yield)
    assert force(YIELDS, deepest, at_yield) == pytest.approx(load, rel=1e-12)
    dents = np.array([unloading(YIELDS, d).dent for d in deepest])
    flatter = RADIUS * STIFFNESS * deepest**1.5 / load
    area = (2.0 * load + first) / (2.0 * math.pi * PRESSURE)
    assert flatter * (deepest - dents) == pytest.approx(area, rel=1e-12)
    for most, left in zip(deepest, dents, strict=True):
        p = np.linspace(-0.1, 1.0, 12) * most
        by_metrics = yielding.elastic_n(LIMITED, p, np.full(12, most))
        assert force(YIELDS, p, most) == pytest.approx(by_metrics, rel=1e-12)
        assert yielding.dent_now_m(LIMITED, most) == pytest.approx(left, rel=1e-12)


@pytest.mark.parametrize("deepest", DEEPEST)
def test_force_and_work_are_continuous_where_the_law_changes(deepest):
    """At the first yield with the slope; at the deepest penetration so far; at the dent."""
    before, after = (law(YIELDS, deepest * (1.0 + e), deepest) for e in (-1e-12, 1e-12))
    assert before[0] == pytest.approx(after[0], rel=1e-10)
    assert before[2] == pytest.approx(after[2], rel=1e-10)
    if deepest == YIELDS.yield_m:
        assert before[1] == pytest.approx(after[1], rel=1e-10)
    _, _, left, lost = unloading(YIELDS, deepest)
    assert law(YIELDS, left - 1e-6, deepest) == (0.0, 0.0, lost)
    value, _, work = law(YIELDS, left + 1e-12, deepest)
    assert 0.0 < value < 1e-6 * before[0]
    assert work == pytest.approx(lost, rel=1e-12, abs=1e-15 * before[2])


@pytest.mark.parametrize("deepest", DEEPEST)
def test_work_is_the_integral_of_the_force(deepest):
    _, _, left, lost = unloading(YIELDS, deepest)
    at_yield = YIELDS.yield_m
    in_and_down = work_j(YIELDS, 0.0, at_yield, at_yield)
    in_and_down += work_j(YIELDS, at_yield, deepest, at_yield)
    deep, back = law(YIELDS, deepest, at_yield)[2], work_j(YIELDS, left, deepest, deepest)
    assert deep == pytest.approx(in_and_down, rel=1e-10)
    assert lost == pytest.approx(deep - back, abs=1e-10 * deep)
    half = 0.5 * (left + deepest)
    _, slope, work = law(YIELDS, half, deepest)
    assert work == pytest.approx(lost + work_j(YIELDS, left, half, deepest), rel=1e-10)
    ends = force(YIELDS, half * np.array([1.0 - 1e-5, 1.0 + 1e-5]), deepest)
    assert slope == pytest.approx(np.diff(ends)[0] / (2e-5 * half), rel=1e-8)


@given(
    st.floats(1e-12, 1e-3),
    st.floats(0.0, 1e-6),
    st.floats(0.0, 30.0),
    st.floats(0.0, 2.0),
)
@example(1.2864658531455843e-04, 3.388203799864356e-07, 19.0, 0.0)  # Newton alone goes in circles
def test_a_spring_in_series_takes_its_share(gap, flexibility, dented, nearby):
    """The force at a modal gap, from any force nearby; the work is done on both."""
    contact = YIELDS._replace(residual_m_n=flexibility)
    deepest = YIELDS.yield_m * max(1.0, dented)
    exact = law(contact, gap, deepest)[0]
    value, slope, work, p = in_series(contact, -gap, unloading(contact, deepest), nearby * exact)
    assert p + flexibility * value == pytest.approx(gap, rel=1e-12)
    own, own_slope, own_work = law(contact, p, deepest)
    assert (value, slope) == pytest.approx((own, own_slope), rel=1e-9)
    assert work == pytest.approx(own_work + 0.5 * flexibility * value**2, rel=1e-9)
