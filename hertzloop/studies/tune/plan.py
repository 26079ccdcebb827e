"""What `tune` searches, checked before any case runs: scenes, laws, ranges."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

from hertzloop.controller.law import LawContext
from hertzloop.controller.loading.registry import find, resolve, shipped
from hertzloop.results.cases import OBJECTIVES
from hertzloop.scene.rules import check_conserves
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.axis import Axis, DesignError, axes_from
from hertzloop.studies.cases.design import Design
from hertzloop.studies.cases.identity import work_of
from hertzloop.studies.tune.request import TuneRequest

# The laws of `--law all`.
LAWS = (
    "slope_threshold",
    "least_squares",
    "shifted_threshold",
    "predicted",
    "fade_out",
    "force_feedback",
    "velocity_feedback",
    "acceleration_feedback",
)
_NOT_OF_CASES = {"laws", "vary", "over", "workers"}  # not what decides the cases, or named apart


@dataclass(frozen=True)
class TunePlan:
    """A search that can be run.

    Attributes:
        bases: The scenes.
        variants: The scenes, each with all combinations of the values to be robust over.
        axes: Axes to search, by law.
        request: What was asked for.
    """

    bases: Sequence[Setup]
    variants: Sequence[Setup]
    axes: dict[str, tuple[Axis, ...]]
    request: TuneRequest

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that decides the cases."""
        request = self.request.model_dump(exclude=_NOT_OF_CASES)
        axes = {law: [asdict(axis) for axis in axes] for law, axes in self.axes.items()}
        varied = Design(tuple(axis for axes in self.axes.values() for axis in axes))
        return work_of(self.variants, self.axes, varied) | {"axes": axes, "search": request}


def plan_tune(
    bases: Sequence[Setup],
    request: TuneRequest,
    check_law: Callable[[Setup], None] = lambda setup: None,
) -> TunePlan:
    """Return the search to run.

    Args:
        bases: The scenes.
        request: What to search.
        check_law: Called with each scene and law before the law is asked for its ranges.

    Raises:
        DesignError: a metric or a range cannot be used.
        SceneError: a scene refuses a law or a value.
    """
    for base in bases:
        check_conserves(base.run.scheme)
    for metric in (*request.minimise, *request.at_most):
        if metric not in OBJECTIVES:
            raise DesignError(
                f"--minimise = '{metric}': unknown metric. Use one of {', '.join(OBJECTIVES)}."
            )
    laws = list(request.laws) or [bases[0].scene.controller.law]
    if laws == ["all"]:
        laws = list(LAWS)
    ranges = tuple(axes_from(request.vary, "--vary"))
    combinations = _combinations(request)
    for axis in ranges:
        if axis.key in combinations[0]:
            raise DesignError(
                f"{axis.key}: is given to both --vary and --over. Remove one of them."
            )
    variants = [base.vary(values) for base in bases for values in combinations]
    speed_m_s = _fastest_m_s(variants)
    axes = {}
    for law in laws:
        for base, values in product(bases, combinations):
            own = {**values, "controller.law": law}
            check_law(base.vary(own))
            for axis in ranges:  # the law may lack the key
                for value in axis.values or (axis.low, axis.high):
                    base.vary({**own, axis.key: value})
        axes[law] = _axes_of(law, ranges, speed_m_s)
        for axis in axes[law]:
            if axis.key in combinations[0]:  # a range of the law, since those given differ
                raise DesignError(
                    f"--over {axis.key}: the search varies this key over the range of '{law}'. "
                    "Name the keys to search with --vary, or remove --over."
                )
    return TunePlan(bases, variants, axes, request)


def _combinations(request: TuneRequest) -> list[dict[str, Any]]:
    """Return all combinations of the values to be robust over."""
    axes = axes_from(request.over)
    for axis in axes:
        if not axis.values:
            raise DesignError(
                f"--over {axis.key}={axis.low:g}:{axis.high:g} has no step; write "
                f"{axis.key}=low:high:step or {axis.key}=a,b,c"
            )
    return Design(tuple(axes)).cases()


def ranges_of(law: str, impact_speed_m_s: float) -> tuple[Axis, ...]:
    """Return the usual ranges of a law's parameters. Raises SceneError."""
    about = LawContext(impact_speed_m_s=impact_speed_m_s)
    ranges = find(resolve(law)).ranges(about).items()
    return tuple(Axis(f"controller.{key}", (), low, high) for key, (low, high) in ranges)


def _axes_of(law: str, given: tuple[Axis, ...], impact_speed_m_s: float) -> tuple[Axis, ...]:
    """Return the axes to search for a law: those `given`, else its own."""
    axes = given or ranges_of(law, impact_speed_m_s)
    if not axes:
        others = ", ".join(name for name in shipped() if ranges_of(name, impact_speed_m_s))
        raise DesignError(
            f"controller.law = '{law}' has no parameters to tune. Use one of {others}, or name "
            "other scene keys with --vary"
        )
    return axes


def _fastest_m_s(scenes: Sequence[Setup]) -> float:
    """Return the largest impact speed of the scenes."""
    return max(setup.plant.sphere.impact_speed_m_s for setup in scenes)
