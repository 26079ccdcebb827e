"""Starting points of a fit."""

import math

from hertzloop.fitting.fit.free_keys import parse_free_key
from hertzloop.fitting.fit.minimise import best_start
from hertzloop.fitting.fit.problem_preparation import prepare_problem
from tests.fitting.fitting import HEIGHT, PRESSURE, YIELDS, record, scene


def test_a_limiting_pressure_starts_beside_the_height_of_the_drop():
    start = scene(YIELDS[0], f"{PRESSURE}=2.5e9")  # at which nothing yields: no gradient
    drop = record(scene(*YIELDS, f"{HEIGHT}=0.05"), seed=1)
    free = [parse_free_key(start, key) for key in (PRESSURE, HEIGHT)]
    problem = prepare_problem(start, [drop], free)
    assert [f.key for f in problem.varied_keys] == [PRESSURE, HEIGHT]
    found = problem.key_values(best_start(problem))
    assert math.isclose(found[PRESSURE], 8e8, rel_tol=0.5)
