"""The cases of a sweep, checked before any of them runs."""

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from hertzloop.results.touch_phases import TOUCH_PHASE_KEY, phases
from hertzloop.scene.rules import check_conserves
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases.axis import DesignError, as_axis, axes_from
from hertzloop.studies.cases.design import Design, design_of
from hertzloop.studies.cases.identity import code_version, laws_of
from hertzloop.studies.cases.uncertain import with_draws
from hertzloop.studies.cases.uncertain_file import read_uncertain
from hertzloop.studies.sweep.request import SweepRequest


@dataclass(frozen=True)
class SweepPlan:
    """A sweep that can be run: the scene, its cases, and what was asked for."""

    setup: Setup
    design: Design
    request: SweepRequest

    @cached_property
    def cases(self) -> list[dict[str, Any]]:
        """Values by scene key, one for each case."""
        return self.design.cases()

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What names this sweep, and goes with its results."""
        return {
            "scene_toml": to_toml(self.setup.scene),
            "design": asdict(self.design),
            "laws": laws_of(self.setup, self.design),
            "span": self.request.span,
            "versions": code_version(),
        }


def plan_sweep(setup: Setup, request: SweepRequest) -> SweepPlan:
    """Return the sweep to run.

    Args:
        setup: The scene.
        request: Which cases to run.

    Raises:
        DesignError: ranges or options do not go together.
        SceneError: the scene refuses a value.
    """
    check_conserves(setup.run.scheme)
    design = _design(setup, request)
    if request.uncertain is not None:
        inputs = read_uncertain(request.uncertain, setup)
        design = with_draws(setup, design, inputs, request.points)
    return SweepPlan(setup, design, request)


def _design(setup: Setup, request: SweepRequest) -> Design:
    """Return the cases before their draws."""
    over, touches, kind = axes_from(request.over), request.phases, request.design
    if request.cases is not None and kind == "grid" and request.uncertain is None:
        raise DesignError(
            f"--cases = {request.cases}: has no effect on a grid, which has all combinations. "
            "Remove it, or use --design sobol or lhs."
        )
    if request.uncertain is not None and kind != "grid":
        raise DesignError(f"--uncertain needs --design grid, not {kind}. Leave it out")
    if touches is not None:
        if any(axis.key == TOUCH_PHASE_KEY for axis in over):
            raise DesignError(
                f"--phases {touches} spreads {TOUCH_PHASE_KEY}, so --over cannot give it too"
            )
        if kind != "grid":
            raise DesignError(
                f"--phases {touches} needs --design grid; with '{kind}' spread them with the "
                f"rest, --over {TOUCH_PHASE_KEY}=0:1"
            )
        over.append(as_axis(TOUCH_PHASE_KEY, phases(touches)))
    if not over and request.uncertain is not None:
        return Design(())
    return design_of(setup, over, kind, request.points, setup.run.seed)
