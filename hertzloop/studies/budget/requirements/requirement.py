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

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from hertzloop.common.missing_files import told_if_unreadable
from hertzloop.common.text_files import text_of
from hertzloop.results.spans import Span
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load
from hertzloop.scene.toml import toml_text
from hertzloop.studies.budget.goal import METRICS, Goal, parse_goal
from hertzloop.studies.pages.words import run_command


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
class SceneRequirement:
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
        return beside(self.folder, self.scene) if self.scene.endswith(".toml") else self.scene

    def settings(self) -> dict[str, Any]:
        """Return the scene keys that the row sets, the law first."""
        law = {} if self.law is None else {"controller.law": beside(self.folder, self.law)}
        return law | self.requirement.set

    def setup(self) -> Setup:
        """Return the scene of the row. Raises SceneError."""
        try:
            return load(self.source, [f"{k}={toml_text(v)}" for k, v in self.settings().items()])
        except SceneError as error:
            raise SceneError(f"{self.name}: {error}") from error

    def command(self, case: dict[str, Any]) -> str:
        """Return the command that runs one case of the row again."""
        return f"{run_command(self.source, self.settings() | case)} --transport compiled"


def beside(folder: Path, name: str) -> str:
    """Return a file that a row names, as a path from the working folder; else the name."""
    file, colon, rest = name.partition(":")
    path = folder / file
    return f"{path}{colon}{rest}" if path.is_file() else name


def read_requirements(path: Path) -> list[SceneRequirement]:
    """Read a file of requirements. Raises SceneError with the row and what is wrong in it."""
    remedy = "Give the path of a file of requirements."
    with told_if_unreadable(path, str(path), remedy, SceneError):
        data = tomllib.loads(text_of(path.read_bytes()))
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
            rows.append(SceneRequirement(one, scene, one.law or for_all.get("law"), path.parent))
    if not rows:
        raise SceneError(f"{path}: has no [[requirement]]. Add at least one")
    names = [row.name for row in rows]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"{path}: two requirements are called '{name}'. Rename one of them")
    return rows
