"""What is said of runs with nothing to compare, and of balance that no energy follows from."""

from hertzloop.loop.simulate import simulate
from hertzloop.scene.build import free_series
from hertzloop.scene.setup import load


def test_uncontrolled_rows_are_those_of_a_run_without_control():
    for name in ("aluminium-20mm", "offcentre-6mm", "thesis-aluminium"):
        scene = load(name, ["controller.law=off"])
        assert free_series(scene).tobytes() == simulate(scene).truth.tobytes()
