"""The search of the command `tune`: checks of what is asked, and the search itself."""

import math
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

from hertzloop.cli import prepare
from hertzloop.cli.terminal import fail, progress
from hertzloop.results.cases import OBJECTIVES
from hertzloop.scene.errors import SceneError
from hertzloop.scene.plant_checks import check_conserves
from hertzloop.scene.setup import Setup
from hertzloop.studies.requests import TuneRequest
from hertzloop.studies.sweeps.design import Axis, Design, DesignError, check_keys, parse_axis
from hertzloop.studies.sweeps.evaluate import CaseTally
from hertzloop.studies.sweeps.journal import JournalEntries
from hertzloop.studies.sweeps.pool import local_pool

if TYPE_CHECKING:
    from hertzloop.studies.margin.margin import Growth
    from hertzloop.studies.tuning import Candidate


@dataclass(frozen=True)
class TuneArguments:
    """What `hertzloop tune` was called with.

    Attributes:
        search: How to search; without the limits of --at-most.
        scenes: Names of the scenes.
        laws: Laws to tune; None: that of the first scene; ["all"]: all that ship.
        ranges: Axes to search, as text; empty: those of the law.
        over: Axes to be robust over, as text.
        at_most: Limits, as text.
        settings: Changes of scene keys.
        seed: Random seed; None: that of each scene.
    """

    search: TuneRequest
    scenes: list[str]
    laws: list[str] | None
    ranges: list[str]
    over: list[str]
    at_most: list[str]
    settings: list[str]
    seed: int | None


@dataclass(frozen=True)
class TuneStudy:
    """What to search, after all checks.

    Attributes:
        bases: The scenes.
        variants: The scenes, each with all combinations of --over.
        laws: The laws.
        ranges: Axes to search; empty: those of each law.
        search: How to search.
    """

    bases: list[Setup]
    variants: list[Setup]
    laws: list[str]
    ranges: tuple[Axis, ...]
    search: TuneRequest

    @property
    def name(self) -> str:
        """Name of the files with results."""
        return "tune-" + "-".join(base.name for base in self.bases)

    @property
    def header(self) -> dict[str, Any]:
        """Everything that decides the cases."""
        from hertzloop.studies import tuning  # of an extra

        return tuning.header_of(self.variants, tuple(self.laws), self.ranges, self.search)


@dataclass(frozen=True)
class TuneResult:
    """What a search found.

    Attributes:
        best: The settings of the Pareto front, with spreads over touch phases.
        growths: Growth of the linear loop of each; None: stable or without such a loop.
        published: The published setting, in the same scenes.
        failed: The reason of each case that could not be run.
        cases: Number of cases.
        ran: Number of cases that were not in the journal.
    """

    best: "list[Candidate]"
    growths: "list[Growth | None]"
    published: "Candidate"
    failed: list[str]
    cases: int
    ran: int


def checked_study(arguments: TuneArguments) -> TuneStudy:
    """Return what to search; end the command for what cannot be searched."""
    from hertzloop.studies import tuning  # of an extra

    bases = [
        prepare.scene_from(name, arguments.settings, arguments.seed) for name in arguments.scenes
    ]
    for base in bases:
        check_conserves(base.scheme)
    search = replace(arguments.search, at_most=_limits(arguments.at_most))
    for metric in (*search.objectives, *search.at_most):
        if metric not in OBJECTIVES:
            fail(f"--minimise = '{metric}': unknown metric. Use one of {', '.join(OBJECTIVES)}.")
    laws = arguments.laws or [bases[0].law_reference]
    if laws == ["all"]:
        laws = list(tuning.LAWS)
    ranges = tuple(parse_axis(text) for text in arguments.ranges)
    check_keys(ranges, "--vary")
    combinations = _combinations(arguments.over)
    for axis in ranges:
        if axis.key in combinations[0]:
            fail(f"{axis.key}: is given to both --vary and --over. Remove one of them.")
    variants = [base.vary(values) for base in bases for values in combinations]
    speed_m_s = tuning.fastest_m_s(variants)
    for law in laws:
        for base, values in product(bases, combinations):
            _check_law_in(base, {**values, "controller.law": law}, ranges)
        tuning.axes_of(law, ranges, speed_m_s)
    return TuneStudy(bases, variants, laws, ranges, search)


def _check_law_in(base: Setup, values: dict[str, Any], ranges: tuple[Axis, ...]) -> None:
    """Check a law in a scene, and the ends of all ranges; the law may lack a key of them."""
    prepare.check_law(base.vary(values))
    for axis in ranges:
        for value in axis.values or (axis.low, axis.high):
            base.vary({**values, axis.key: value})


def _combinations(over: list[str]) -> list[dict[str, Any]]:
    """Return all combinations of the values to be robust over. Raises DesignError."""
    axes = tuple(parse_axis(text) for text in over)
    check_keys(axes)
    for axis in axes:
        if not axis.values:
            raise DesignError(
                f"--over {axis.key}={axis.low:g}:{axis.high:g} has no step; write "
                f"{axis.key}=low:high:step or {axis.key}=a,b,c"
            )
    return Design(axes).cases()


def _limits(texts: list[str]) -> dict[str, float]:
    """Return the limits of --at-most by metric; end the command for one that is no number."""
    limits = {}
    for text in texts:
        match = re.fullmatch(r"\s*(\w+)\s*=\s*(\S+)\s*", text)
        with suppress(ValueError):
            if match and math.isfinite(float(match[2])):
                limits[match[1]] = float(match[2])
                continue
        fail(
            f"--at-most = '{text}': invalid limit. Write metric=number, as in rebound_percent=120."
        )
    return limits


def search_settings(study: TuneStudy, finished: JournalEntries) -> TuneResult:
    """Search, with a progress bar; end the command with exit code 1 if a scene fails.

    Args:
        study: What to search.
        finished: Cases that an earlier start of the command has finished.
    """
    from hertzloop.studies import tuning  # of an extra

    search, variants, tally = study.search, study.variants, CaseTally()
    objectives, span = search.objectives, search.span
    steps = search.generations * len(study.laws)
    try:
        with local_pool() as workers, progress("tuning", steps) as advance:
            pool = finished.of(workers)
            counted = tally.of(pool)
            published = tuning.published(counted, variants, span, objectives, search.phases)
            best = tuning.best_of(counted, variants, study.laws, study.ranges, search, advance)
            published, *best = tuning.with_spreads(
                pool, variants, span, [published, *best], objectives
            )
    except SceneError as error:
        fail(str(error), 1)
    return TuneResult(
        best=best,
        growths=[tuning.unstable_loop(variants, candidate.values) for candidate in best],
        published=published,
        failed=[row["status"] for row in tally.not_run],
        cases=tally.cases,
        ran=finished.ran,
    )
