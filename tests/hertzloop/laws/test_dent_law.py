"""A law that knows the dent: its forces are the contact's own, and it buys what the dent costs."""

import math
from typing import Any

import numpy as np
import pytest

from hertzloop.controller.laws.dent_threshold import contact_force, dent
from hertzloop.controller.loading.registry import find
from hertzloop.law import LawContext
from hertzloop.loop.simulate import simulate
from hertzloop.plant.contact.hertz import Limit
from hertzloop.plant.contact.yielding import dent_m, force_n, yielding
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.setup import Setup, load
from tests.hertzloop.scenes import aluminium_3mm

# These need a kind of plant of their own, whose kernels take half a minute to compile.
pytestmark = pytest.mark.full

STIFFNESS, LIMIT = 4.5e9, Limit(1.05e9, 0.003)


def law_of(limit: Limit | None) -> Any:
    depth = math.inf if limit is None else yielding(limit, STIFFNESS).delta_m
    home = find("dent_threshold")
    return home.constants(home.keys(), LawContext(stiffness=STIFFNESS, yield_depth_m=float(depth)))


def test_its_forces_are_those_of_a_contact_that_yields():
    law, constants = yielding(LIMIT, STIFFNESS), law_of(LIMIT)
    for deepest in np.array([0.5, 1.01, 2.0, 8.0]) * law.delta_m:
        left = dent_m(law, STIFFNESS, np.array(deepest))
        assert dent(constants, deepest) == pytest.approx(float(left), abs=1e-20)
        for depth in np.array([0.2, 0.7, 0.999, 1.0]) * deepest:
            wanted = force_n(law, STIFFNESS, np.array(depth), np.array(deepest))
            found = contact_force(constants, depth, deepest)
            assert found == pytest.approx(float(wanted), rel=1e-9, abs=1e-12)


def scene(*settings: str) -> Setup:
    return aluminium_3mm("run.duration_s=0.0016", *settings)


def test_on_an_elastic_plate_it_is_the_published_law():
    published, knowing = (
        simulate(scene(f"controller.law={name}", "sensors.bits=12")).forces
        for name in ("slope_threshold", "dent_threshold")
    )
    assert published.any()
    assert np.allclose(knowing, published, rtol=1e-9, atol=1e-9)
    assert scene().about_mechanics.yield_depth_m == math.inf


# dB against no control on a plate of 1.05 GPa, at a touch in the middle of a step.
@pytest.mark.parametrize(
    ("v_thr", "published_db", "knowing_db"), [(-0.25, 2.20, 0.38), (-0.6, 0.84, -1.35)]
)
def test_what_knowing_the_dent_buys(v_thr, published_db, knowing_db):
    yields = ("contact.plasticity=thornton", "contact.limiting_pressure_pa=1.05e9")
    found = [
        metrics_of_case(scene(*yields, f"controller.law={law}", f"controller.v_thr_m_s={v_thr}"))
        for law in ("slope_threshold", "dent_threshold")
    ]
    assert found[0].plate_energy_db == pytest.approx(published_db, abs=0.03)
    assert found[1].plate_energy_db == pytest.approx(knowing_db, abs=0.03)
    # It does not push an empty plate: the sphere rises less.
    assert found[1].rebound_percent < 0.86 * found[0].rebound_percent


def test_it_remembers_the_dent_when_the_sphere_comes_back():
    yields = ("contact.plasticity=thornton", "contact.limiting_pressure_pa=0.3e9")
    run = simulate(
        load("aluminium-20mm", ["controller.law=dent_threshold", "run.duration_s=0.012", *yields])
    )
    acting = np.flatnonzero(np.diff((run.modes == 2).astype(int)) == 1)
    assert len(acting) >= 2  # it acts in later contacts too
    below = (run.truth[4] == 0.0) & (run.truth[0] < 0.0)
    assert below.any()  # lower than the plate's face and yet free: it takes the dent to know that
    assert np.all(run.modes[below[: len(run.modes)]] != 1)
