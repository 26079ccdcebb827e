"""Requirements on a law in a file beside it: rows that a command or pytest checks.

```toml
[hertzloop]                                    # tells pytest that this file is for hertzloop
law = "mine.py"                                # for all rows; a row may name another

[[requirement]]
name = "works with 5 us of latency"
scene = "aluminium-3mm"                        # or scenes = ["aluminium-3mm", "oak-20mm"]
set = { "controller.latency_us" = 5 }
goal = "plate_energy_db <= -0.1"               # or a list
phases = 5
```

A row may also have `expect` (metrics and their values), `limit` (quantities of `hertzloop budget`
that must be tolerated), or `probability` with `uncertain`.
"""

import math
import shlex
import time
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.text_files import text_of
from hertzloop.results.cases import CASE_METRICS, CaseState, Span
from hertzloop.scene import model_error
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from hertzloop.studies.budget.budget import search_of
from hertzloop.studies.budget.goal import METRICS, Goal, parse_goal, worst_excess
from hertzloop.studies.budget.limits import (
    LEAST,
    Boundary,
    BudgetLimit,
    limit_of,
    limit_words,
    quantities_of,
    side_by_side,
)
from hertzloop.studies.budget.probability import probability
from hertzloop.studies.budget.stability import instability, linear_margin, tolerated
from hertzloop.studies.cases.design import toml_text
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.touch_phases import phases as spread_evenly
from hertzloop.studies.cases.uncertain import read_uncertain
from hertzloop.studies.margin.margin import Margin


class Requirement(BaseModel):
    """A row of a file of requirements."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    scene: str | None = None
    scenes: tuple[str, ...] = ()
    law: str | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    goal: str | tuple[str, ...] = ()
    expect: dict[str, float] = Field(default_factory=dict)
    limit: dict[str, float] = Field(default_factory=dict)
    tolerance: dict[str, float] = Field(default_factory=dict)
    phases: int = Field(default=5, ge=1, le=1000)
    span: Span = "impact"
    probability: float | None = Field(default=None, gt=0.0, lt=1.0)
    uncertain: str | None = None
    cases: int = Field(default=1024, ge=16)

    @property
    def goals(self) -> tuple[Goal, ...]:
        """The goals."""
        texts = (self.goal,) if isinstance(self.goal, str) else self.goal
        return tuple(parse_goal(text) for text in texts)

    @model_validator(mode="after")
    def _complete(self) -> "Requirement":
        if bool(self.scene) == bool(self.scenes):
            raise ValueError("needs scene or scenes, one of them")
        if not (self.goal or self.expect or self.limit):
            raise ValueError("needs goal, expect or limit")
        if (self.probability is None) != (self.uncertain is None):
            raise ValueError("needs probability and uncertain together")
        if self.probability is not None and not self.goal:
            raise ValueError("has a probability, so it needs a goal")
        for metric in (*self.expect, *self.tolerance):
            if metric not in METRICS:
                raise ValueError(f"{metric} is not a metric; choose from {', '.join(METRICS)}")
        _ = self.goals
        return self


@dataclass(frozen=True)
class Row:
    """A requirement in one scene; files that it names are beside `folder`."""

    requirement: Requirement
    scene: str
    law: str | None
    folder: Path

    @property
    def name(self) -> str:
        """Name of the row, with the scene where the requirement has several."""
        several = len(self.requirement.scenes) > 1
        return f"{self.requirement.name} [{self.scene}]" if several else self.requirement.name

    @property
    def source(self) -> str:
        """The scene as a path from the working folder, or its shipped name."""
        return _beside(self.folder, self.scene) if self.scene.endswith(".toml") else self.scene

    def settings(self) -> dict[str, Any]:
        """Return the scene keys that the row sets, the law first."""
        law = {} if self.law is None else {"controller.law": _beside(self.folder, self.law)}
        return law | self.requirement.set

    def setup(self) -> Setup:
        """Return the scene of the row. Raises SceneError."""
        try:
            return load(self.source, [f"{k}={toml_text(v)}" for k, v in self.settings().items()])
        except SceneError as error:
            raise SceneError(f"{self.name}: {error}") from error

    def command(self, case: dict[str, Any]) -> str:
        """Return the command that runs one case of the row again."""
        given = self.settings() | case
        words = [w for key, value in given.items() for w in ("--set", f"{key}={toml_text(value)}")]
        return shlex.join(["hertzloop", "run", self.source, *words, "--transport", "compiled"])


def _beside(folder: Path, name: str) -> str:
    file, colon, rest = name.partition(":")
    path = folder / file
    return f"{path}{colon}{rest}" if path.is_file() else name


@dataclass(frozen=True)
class Checked:
    """What became of a row: sentences on what holds and by how much, on what fails, and on a linear
    loop that is unstable while the row holds; the command that reproduces the failure; whether the
    loop is unstable, in a run or by linear theory."""

    row: Row
    holds: tuple[str, ...]
    fails: tuple[str, ...]
    command: str
    unstable: bool
    seconds: float
    measured: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the row holds."""
        return not self.fails


def read_requirements(path: Path) -> list[Row]:
    """Read a file of requirements. Raises SceneError with the row and what is wrong in it."""
    try:
        data = tomllib.loads(text_of(path.read_bytes()))
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be read: {error}") from error
    for_all = data.get("hertzloop")
    if not isinstance(for_all, dict):
        raise SceneError(f"{path}: has no table [hertzloop]. Add it, with law = FILE for all rows")
    unknown = {*data, *(f"hertzloop.{key}" for key in for_all)}
    if unknown := unknown - {"hertzloop", "hertzloop.law", "requirement"}:
        raise SceneError(
            f"{path}: {', '.join(sorted(unknown))} is unknown. Use hertzloop.law, requirement"
        )
    rows = []
    for number, given in enumerate(data.get("requirement", []), 1):
        try:
            one = Requirement.model_validate(given)
        except ValidationError as error:
            problem = error.errors()[0]
            where = ".".join(map(str, problem["loc"]))
            sentence = problem["msg"].removeprefix("Value error, ")
            raise SceneError(
                f"{path}, requirement {number}{where and f', {where}'}: {sentence}. Correct the row"
            ) from error
        for scene in one.scenes or (one.scene or "",):
            rows.append(Row(one, scene, one.law or for_all.get("law"), path.parent))
    if not rows:
        raise SceneError(f"{path}: has no [[requirement]]. Add at least one")
    names = [row.name for row in rows]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"{path}: two requirements are called '{name}'. Rename one of them")
    return rows


def digits_of(setup: Setup, metric: str, value: float) -> float:
    """Return the part of a metric that cannot be predicted, in its unit: what the expected error of
    the plate's model makes of it, at least the accuracy of the scene."""
    error = max(setup.accuracy, model_error.expected_error(setup))
    if metric.endswith("_db"):
        return (CASE_METRICS[metric].db or 10.0) * math.log10(1.0 + error)
    return 2.0 * error * abs(value)


def check(pool: Pool, row: Row) -> Checked:
    """Check one row.

    Args:
        pool: Runs cases.
        row: The requirement in one scene.

    Raises:
        SceneError: the row cannot be run.
    """
    began_s = time.perf_counter()
    one, setup = row.requirement, row.setup()
    holds: list[str] = []
    fails: list[str] = []
    command, measured, unstable = "", {}, False
    margin = linear_margin(setup)
    grows = instability(margin) if margin is not None and margin.stable is False else ""
    if (one.goal and one.probability is None) or one.expect:
        cases = [{"run.touch_phase": phase} for phase in spread_evenly(one.phases)]
        expected_at: list[dict[str, Any]] = [{}] if one.expect else []
        rows = evaluate(pool, setup, one.span, [*expected_at, *cases])
        for each in rows:
            if each["state"] == CaseState.NOT_RUN:
                raise SceneError(f"{row.name}: {each['status']}")
        over = rows[len(expected_at) :]
        for each, case in zip(rows, [*expected_at, *cases], strict=True):
            if each["state"] == CaseState.UNSTABLE and not unstable:
                unstable, command = True, row.command(case)
                fails.append("the closed loop is unstable")
        for metric, value in one.expect.items():
            got = rows[0][metric]
            measured[metric] = math.nan if got is None else float(got)
            allowed = one.tolerance.get(metric, digits_of(setup, metric, value))
            off = abs(measured[metric] - value)
            sentence = (
                f"{metric} = {measured[metric]:.6g}, expected {value:.6g} within {allowed:.2g}"
            )
            if off <= allowed:
                holds.append(sentence)
            elif not unstable:
                fails.append(sentence)
                command = command or row.command({})
        for goal in one.goals if one.probability is None else ():
            worst = max(range(len(over)), key=lambda i: worst_excess([goal], over[i]))
            excess = goal.excess(over[worst])
            allowed = one.tolerance.get(goal.metric, digits_of(setup, goal.metric, goal.limit))
            if excess <= allowed:
                holds.append(f"{goal} with {-excess:.3g} to spare")
            elif math.isfinite(excess):
                fails.append(
                    f"{goal} is missed by {excess:.3g}: {goal.metric} = "
                    f"{over[worst][goal.metric]:.6g} at run.touch_phase = "
                    f"{cases[worst]['run.touch_phase']:g}"
                )
                command = command or row.command(cases[worst])
            elif not unstable:
                fails.append(f"{goal}: the metric is not defined in this scene")
                command = command or row.command(cases[worst])
    if one.limit:
        more, worst_case = _check_limits(pool, setup, one, margin, holds)
        fails += more
        if more:
            command = command or row.command(worst_case)
    if one.probability is not None and one.uncertain is not None:
        uncertain = read_uncertain(Path(_beside(row.folder, one.uncertain)), setup)
        found = probability(
            pool, setup, one.goals, uncertain, one.span, within=0.01, most=one.cases
        )
        low, high = found.interval
        sentence = (
            f"probability {found.value:z.4f} ({low:z.4f} to {high:z.4f}, {found.cases} cases), "
            f"required {one.probability:g}"
        )
        # The lower end counts: the required probability has to be shown, not only possible.
        if low >= one.probability:
            holds.append(sentence)
        else:
            fails.append(sentence)
            command = command or row.command(found.worst)
    # A row that fails by the instability says so already.
    said_already = unstable or any(grows in sentence for sentence in fails)
    warnings = () if not grows or said_already else (grows,)
    return Checked(
        row,
        tuple(holds),
        tuple(fails),
        command,
        unstable or bool(grows),
        time.perf_counter() - began_s,
        measured,
        warnings,
    )


def _check_limits(
    pool: Pool, setup: Setup, one: Requirement, margin: Margin | None, holds: list[str]
) -> tuple[list[str], dict[str, Any]]:
    """What fails of the limits of a row, and a case that shows it; what holds goes to `holds`."""
    known = {quantity.name: quantity for quantity in quantities_of(setup)}
    for name in one.limit:
        if name not in known:
            raise SceneError(
                f"{one.name}, limit.{name}: is not a quantity. Choose from {', '.join(known)}"
            )
    goals = one.goals or (parse_goal("plate_energy_db <= -0.1"),)
    search = search_of(setup, False, one.span)
    searched = side_by_side(
        [limit_of(known[name], goals, search) for name in one.limit],
        lambda cases: evaluate(pool, setup, one.span, cases),
    )
    limits = [
        tolerated(setup, margin, known[found.quantity], found, search.points) for found in searched
    ]
    fails: list[str] = []
    case: dict[str, Any] = {}
    for found in limits:
        wanted = one.limit[found.quantity]
        least = found.quantity in LEAST
        enough = found.boundary is Boundary.NO_LIMIT or (
            found.value is not None
            and (found.value <= wanted if least else found.value >= wanted - 1e-12)
        )
        sentence = _limit_sentence(found, wanted, margin, one.span)
        if enough:
            holds.append(sentence)
        else:
            fails.append(sentence)
            if found.boundary is Boundary.UNSTABLE:  # the scene shows it, latency at its least
                case = case or ({found.key: 0} if found.quantity == "latency_us" else {})
                continue
            scale = known[found.quantity].scale
            value = wanted / scale
            whole = found.key in ("sensors.bits", "sensors.every_steps")
            case = case or {found.key: round(value) if whole else value}
    return fails, case


def _limit_sentence(found: BudgetLimit, wanted: float, margin: Margin | None, span: Span) -> str:
    """What is tolerated and required; the instability where it sets the limit."""
    if found.impact_alone is None:
        got = found.boundary.value if found.value is None else f"{found.value:.6g}"
        return f"{found.quantity}: tolerated {got} {found.unit}, required {wanted:.6g}"
    if found.boundary is Boundary.UNSTABLE:
        why = instability(margin) or "the linear loop is unstable there"
    else:
        why = f"the linear loop is unstable at {found.first_failure:.6g} {found.unit}"
    return (
        f"{found.quantity}: tolerated {limit_words(found)}, required {wanted:.6g}, because {why}; "
        f"tolerated by the {span} alone: {limit_words(found.impact_alone)}"
    )


def junit(path: Path, found: Sequence[Checked]) -> None:
    """Write the results as JUnit XML. Raises NotWritten."""
    suite = ET.Element(
        "testsuite",
        name="hertzloop budget",
        tests=str(len(found)),
        failures=str(sum(not one.passed for one in found)),
        errors="0",
        skipped="0",
        time=f"{sum(one.seconds for one in found):z.3f}",
    )
    for one in found:
        case = ET.SubElement(
            suite,
            "testcase",
            classname=f"requirements.{one.row.scene}",
            name=one.row.name,
            time=f"{one.seconds:z.3f}",
        )
        if not one.passed:
            failure = ET.SubElement(case, "failure", message="; ".join(one.fails))
            failure.text = f"{'; '.join(one.fails)}\nReproduce: {one.command}"
        ET.SubElement(case, "system-out").text = "\n".join((*one.holds, *one.warnings))
    root = ET.Element("testsuites")
    root.append(suite)
    ET.indent(root)
    atomic_write(path, ET.tostring(root, encoding="utf-8", xml_declaration=True))
