"""Which sweeps can search the worst latencies of their cases."""

from typing import Any

from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.cases import OBJECTIVES
from hertzloop.scene.errors import shortened, shown
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.axis import DesignError
from hertzloop.studies.cases.design import Design

_OTHER_LATENCIES = ("latency_trace", "clock_ppm", "drop_out_probability")


def check_worst(setup: Setup, design: Design, metric: str) -> None:
    """Refuse a design in which the worst value of a metric within the jitter cannot be searched.

    Raises:
        DesignError: The metric is unknown; no case has jitter, or a law; or a case has latencies
            other than a constant and jitter.
    """
    if metric not in OBJECTIVES:
        raise DesignError(
            f"--worst = {shown(metric)}: unknown metric. Use one of {', '.join(OBJECTIVES)}."
        )
    cases, own = design.cases(), setup.scene.controller

    def values(name: str) -> list[Any]:
        return [case.get(f"controller.{name}", getattr(own, name)) for case in cases]

    if set(values("law")) == {NO_CONTROL}:
        raise DesignError(
            f"controller.law = '{NO_CONTROL}': latencies have no effect. Name a law, or leave out "
            "--worst."
        )
    if not any(values("jitter_us")):
        raise DesignError(
            "controller.jitter_us = 0: --worst searches the latencies within the jitter. Add for "
            "example --set controller.jitter_us=5."
        )
    for name in _OTHER_LATENCIES:
        for value in filter(None, values(name)):
            raise DesignError(
                f"controller.{name} = {shortened(str(value))}: --worst searches all latencies. "
                "Remove the key."
            )
