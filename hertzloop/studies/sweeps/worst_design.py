"""Which sweeps can search the worst latencies of their cases."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.cases import OBJECTIVES
from hertzloop.scene.errors import shortened, shown
from hertzloop.scene.setup import Setup
from hertzloop.studies.sweeps.design import Design, DesignError

_OTHER_LATENCIES = ("latency_trace", "clock_ppm", "drop_out_probability")


def with_worst(setup: Setup, design: Design, metric: str) -> Design:
    """Return a design whose cases search the worst value of a metric within their jitter.

    Raises:
        DesignError: The metric is unknown; no case has jitter, or a law; or a case has latencies
            other than a constant and jitter.
    """
    if metric not in OBJECTIVES:
        raise DesignError(
            f"--worst = {shown(metric)}: unknown metric. Use one of {', '.join(OBJECTIVES)}."
        )
    if set(_values(setup, design, "law")) == {NO_CONTROL}:
        raise DesignError(
            f"controller.law = '{NO_CONTROL}': latencies have no effect. Name a law, or leave out "
            "--worst."
        )
    if not any(_values(setup, design, "jitter_us")):
        raise DesignError(
            "controller.jitter_us = 0: --worst searches the latencies within the jitter. Add for "
            "example --set controller.jitter_us=5."
        )
    for key in _OTHER_LATENCIES:
        given = next((value for value in _values(setup, design, key) if value), None)
        if given is not None:
            raise DesignError(
                f"controller.{key} = {shortened(str(given))}: --worst searches all latencies. "
                "Remove the key."
            )
    return replace(design, worst=metric)


def _values(setup: Setup, design: Design, name: str) -> Sequence[Any]:
    """Return the values that a key of the controller has in the cases; the ends of a range."""
    key = f"controller.{name}"
    for axis in design.axes:
        if axis.key == key:
            return axis.values or (axis.low, axis.high)
    if key in design.drawn_keys:
        place = design.drawn_keys.index(key)
        return [row[place] for row in design.drawn]
    return [getattr(setup.scene.controller, name)]
