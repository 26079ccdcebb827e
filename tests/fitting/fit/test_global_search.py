"""Starting points of a fit."""

import math
from dataclasses import replace

from hertzloop.fitting.fit.keys.free_key_option import parse_free_key
from hertzloop.fitting.fit.problem.hit_speeds import add_hit_speeds
from hertzloop.fitting.fit.problem.problem_preparation import prepare_problem
from hertzloop.fitting.fit.solver.global_search import best_start
from tests.fitting.fitting import HEIGHT, PRESSURE, YIELDS, record, scene


def test_a_limiting_pressure_starts_beside_the_heights_of_several_drops():
    start = scene(*YIELDS)
    drops = [
        replace(record(scene(*YIELDS, f"{HEIGHT}={height}"), seed=seed), hit=seed)
        for seed, height in ((1, 0.05), (2, 0.04))
    ]
    free = add_hit_speeds(start, drops, [parse_free_key(start, key) for key in (PRESSURE, HEIGHT)])
    problem = prepare_problem(start, drops, free)
    assert [f.key for f in problem.varied_keys] == [PRESSURE, f"{HEIGHT}[1]", f"{HEIGHT}[2]"]
    found = problem.key_values(best_start(problem))
    assert math.isclose(found[PRESSURE], 8e8, rel_tol=0.5)
