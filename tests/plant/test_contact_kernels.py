"""The contact kernels alone: chord, contact_force, solve_contact, against 50-digit arithmetic."""

from decimal import Decimal, localcontext
from functools import cache

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from hertzloop.plant.contact.hertz import Contact, hunt_crossley_parameter, rigid_contact_time_s
from hertzloop.plant.schemes import discrete_gradient_kernels as chords
from hertzloop.plant.schemes import discrete_gradient_kernels as k
from tests.plant.rigs import rigid

# Additions and roots of a force: a dozen roundings of 1.1e-16 each, with room for pow.
ROUNDING = 1e-14

magnitudes = st.floats(-15, -1).map(lambda e: 10.0**e)
gaps = st.one_of(st.just(0.0), magnitudes, magnitudes.map(lambda x: -x))
stiffnesses = st.floats(3, 13).map(lambda e: 10.0**e)
gains = st.floats(-14, 0).map(lambda e: 10.0**e)
viscous = st.one_of(st.just(0.0), st.floats(-3, 4).map(lambda e: 10.0**e))
hunt_crossley = st.one_of(st.just(0.0), st.floats(-3, 2).map(lambda e: 10.0**e))


@cache  # to build it compiles kernels
def usual() -> k.PlantModel:
    return rigid(1e-6, Contact(1.0)).model


def model(s: float, c: float = 0.0, d: float = 0.0) -> k.PlantModel:
    return usual()._replace(stiffness=s, viscous_n_s_m=c, hunt_crossley_s_m=d)


def potential(s: float, xi: Decimal) -> Decimal:
    p = max(-xi, Decimal(0))
    return Decimal(s) * p * p * p.sqrt() * 2 / 5


def exact_force(m: k.PlantModel, xi0: float, xi1: Decimal) -> tuple[Decimal, Decimal]:
    """Elastic and damping force as the design states them: differences of the potential."""
    start = Decimal(xi0)
    v0, v1 = potential(m.stiffness, start), potential(m.stiffness, xi1)
    elastic = (v1 - v0) / (start - xi1)
    rate = (max(-xi1, Decimal(0)) - max(-start, Decimal(0))) / Decimal(m.step_s)
    both = xi0 <= 0.0 and xi1 <= 0
    # Hunt-Crossley: d times the mean of s p^(3/2) over the penetrations times their rate.
    hunt = elastic * rate if both else (v1 - v0) / Decimal(m.step_s)
    return elastic, Decimal(m.viscous_n_s_m) * rate + Decimal(m.hunt_crossley_s_m) * hunt


@given(magnitudes, magnitudes)
def test_chord_is_the_mean_of_the_hertz_law(p0: float, p1: float) -> None:
    assume(p0 != p1)
    with localcontext(prec=60):
        expected = exact_force(model(1.0), -p0, -Decimal(p1))[0]
    assert chords.chord(p0, p1)[0] == pytest.approx(float(expected), rel=ROUNDING)
    assert chords.chord(p0, p0)[0] == pytest.approx(p0**1.5, rel=ROUNDING)


@given(gaps, gaps, stiffnesses, viscous, hunt_crossley)
def test_force_and_its_slope(xi0: float, xi1: float, s: float, c: float, d: float) -> None:
    assume(xi0 != xi1)
    m = model(s, c, d)
    force, damping, slope = chords.contact_force(m, xi0, xi1)
    with localcontext(prec=60):
        x = Decimal(xi1)
        elastic, damped = exact_force(m, xi0, x)
        size = float(abs(elastic) + abs(damped))
        assert damping == pytest.approx(float(damped), rel=ROUNDING, abs=0.0)
        assert force == pytest.approx(float(elastic + damped), abs=ROUNDING * size)
        assert slope <= 0.0
        if xi1 != 0.0:  # a kink there: no derivative
            tiny = abs(x) * Decimal("1e-20")
            ahead, behind = (sum(exact_force(m, xi0, x + e)) for e in (tiny, -tiny))
            # Both terms fall with xi1, so nothing cancels beyond the terms' own roundings.
            expected = float((ahead - behind) / (2 * tiny))
            assert slope == pytest.approx(expected, rel=1e-12, abs=ROUNDING * size / abs(xi1))


@given(gaps, gaps, stiffnesses)
def test_undamped_force_is_the_discrete_gradient(xi0: float, xi1: float, s: float) -> None:
    force, damping, _ = chords.contact_force(model(s), xi0, xi1)
    assert force >= 0.0
    assert damping == 0.0
    with localcontext(prec=60):
        x0, x1 = Decimal(xi0), Decimal(xi1)
        work = Decimal(force) * (x1 - x0)
        stored = potential(s, x1) - potential(s, x0)
        assert abs(work + stored) <= Decimal(ROUNDING) * abs(work)


@given(gaps, gaps, gaps, stiffnesses, viscous, hunt_crossley)
def test_force_falls_with_the_gap(
    xi0: float, a: float, b: float, s: float, c: float, d: float
) -> None:
    m = model(s, c, d)
    near, far = min(a, b), max(a, b)
    f_near, d_near, _ = chords.contact_force(m, xi0, near)
    f_far, d_far, _ = chords.contact_force(m, xi0, far)
    size = abs(f_near - d_near) + abs(d_near) + abs(f_far - d_far) + abs(d_far)
    assert f_near >= f_far - ROUNDING * size


@settings(max_examples=300)
@given(gaps, gaps, gains, stiffnesses, viscous, hunt_crossley)
def test_solve_contact_finds_the_root(
    xi0: float, xi_free: float, gain: float, s: float, c: float, d: float
) -> None:
    m = model(s, c, d)
    force, _, _ = chords.solve_contact(m, xi0, xi_free, gain)
    xi1 = xi_free + gain * force

    def mismatch(x: float) -> float:
        with localcontext(prec=60):
            # Next to xi0 where the exact force divides by zero.
            at = Decimal(x) + (Decimal("1e-40") if x == xi0 else 0)
            return float(at - Decimal(xi_free) - Decimal(gain) * sum(exact_force(m, xi0, at)))

    reach = abs(xi_free) + 2.0 * abs(gain * chords.contact_force(m, xi0, xi_free)[0]) + 1e-30
    low, high = xi_free - reach, xi_free + reach
    root = brentq(mismatch, low, high, xtol=1e-16 * reach, maxiter=500)
    _, damping, slope = chords.contact_force(m, xi0, root)
    # The root is known to a rounding of itself, which the steepness of the force magnifies.
    scale = (1.0 - gain * slope) * abs(root) + abs(xi_free) + gain * (abs(force) + abs(damping))
    assert abs(xi1 - root) <= ROUNDING * scale + 1e-16 * reach


@settings(max_examples=1000)
@given(gaps, gaps, gains, stiffnesses)
def test_solve_contact_ends_for_any_undamped_step(
    xi0: float, xi_free: float, gain: float, s: float
) -> None:
    # 12 Newton steps, then a bisection every other time: 53 bits and 14 decades of bracket.
    assert chords.solve_contact(model(s), xi0, xi_free, gain)[2] <= 150


@settings(max_examples=1000)
@given(
    stiffnesses,
    st.floats(-6, 2),  # decades of mass
    st.floats(-3, 2),  # of speed
    st.floats(1.5, 4),  # of steps in a contact
    st.floats(0.02, 1.0),
    st.floats(0.0, 3.0),
    st.integers(-20, 1000).map(lambda n: n / 1000),
    st.integers(-1000, 1000).map(lambda n: n / 1000),
)
def test_solve_contact_is_quick_where_steps_resolve_the_contact(
    s: float, mass: float, speed: float, steps: float, restitution: float, viscous: float,
    depth: float, way: float,
) -> None:  # fmt: skip
    mass, speed = 10.0**mass, 10.0**speed
    contact_s = rigid_contact_time_s(mass, s, speed)
    step_s = contact_s / 10.0**steps
    xi0 = -depth * (1.25 * mass * speed**2 / s) ** 0.4
    gain = step_s**2 / mass
    d = hunt_crossley_parameter(restitution, speed)
    way = min(way, restitution)  # a sphere does not leave faster
    for m in (model(s), model(s, d=d), model(s, c=viscous * mass / contact_s)):
        found = chords.solve_contact(
            m._replace(step_s=step_s), xi0, xi0 + way * speed * step_s, gain
        )
        assert found[2] <= 8  # 6 is the most met in 150 000 random problems


def test_solve_contact_stops_between_neighbouring_doubles() -> None:
    # A plate that gives way so much that damping, not inertia, decides the next gap.
    m = model(36969458.723302245, 14.642637918905685, 89.24685581736642)
    gap, free, gain = -0.09745193253909562, -2.212870118542158e-06, 1.8809216755703732e-10
    assert chords.solve_contact(m, gap, free, gain)[2] < 100
