"""A plug-in for pytest: rows of requirements.toml as tests, and a fixture that simulates a case.

pytest finds it by its entry point once hertzloop is installed; `-p no:hertzloop` turns it off. It
imports the rest of hertzloop only for a file of requirements or the fixture.
"""

import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pytest

from hertzloop.common.text_files import text_of

if TYPE_CHECKING:
    from hertzloop.results.cases import CaseMetrics
    from hertzloop.studies.budget.requirements.requirement import SceneRequirement

_FILE = "requirements.toml"
_HEADING = re.compile(r"^[ \t]*\[[ \t]*hertzloop[ \t]*\]", re.MULTILINE)


class RequirementFailed(Exception):
    """A row of requirements.toml fails. The message holds the command that reproduces it."""


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect files named requirements.toml that have a table [hertzloop]."""
    if file_path.name != _FILE:
        return None
    try:
        ours = _HEADING.search(text_of(file_path.read_bytes()))
    except (OSError, ValueError):
        return None  # another tool may use this name
    return RequirementsFile.from_parent(parent, path=file_path) if ours else None


class RequirementsFile(pytest.File):
    """A file of requirements; its rows are the tests."""

    def collect(self) -> Iterable[pytest.Item]:
        """Return a test for each row in each of its scenes."""
        from hertzloop.scene.errors import SceneError
        from hertzloop.studies.budget.requirements.requirement import read_requirements

        try:
            rows = read_requirements(self.path)
        except SceneError as error:
            raise self.CollectError(str(error)) from error
        for row in rows:
            yield RequirementItem.from_parent(self, name=row.name, row=row)


class RequirementItem(pytest.Item):
    """A row of requirements."""

    def __init__(self, *, row: "SceneRequirement", **named: Any) -> None:
        super().__init__(**named)
        self.row = row

    def runtest(self) -> None:
        """Check the row.

        Raises:
            RequirementFailed: a goal, a limit, a probability or an expected metric fails.
        """
        from hertzloop.studies.budget.requirements.check import check
        from hertzloop.studies.cases.pool import local_pool

        with local_pool(1) as pool:
            found = check(pool, self.row)
        self.add_report_section("call", "holds", "\n".join(found.holds))
        for warning in found.warnings:
            warnings.warn(pytest.PytestWarning(f"{self.name}: {warning}"), stacklevel=1)
        if not found.passed:
            raise RequirementFailed("; ".join(found.fails) + f"\nReproduce: {found.command}")

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the message of a failed row without a traceback."""
        from hertzloop.scene.errors import SceneError

        if isinstance(excinfo.value, RequirementFailed | SceneError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return the file, no line, and the name of the row."""
        return self.path, None, f"requirement: {self.name}"


@pytest.fixture
def hertzloop_run() -> "Callable[..., CaseMetrics]":
    """Return a function that simulates one case.

    Returns:
        A function `run(scene="aluminium-3mm", law=None, changes=None, span="impact")`, which
        returns `CaseMetrics` or raises SceneError or UnstableLoop. `law` is a shipped name or a
        file, `changes` holds values by scene key, and `span` is "impact" or "run".
    """

    def run(
        scene: str = "aluminium-3mm",
        law: str | None = None,
        changes: Mapping[str, Any] | None = None,
        span: Literal["impact", "run"] = "impact",
    ) -> "CaseMetrics":
        from hertzloop.results.cases import metrics_of_case
        from hertzloop.scene.setup import load

        setup = load(scene, [] if law is None else [f"controller.law={law}"])
        return metrics_of_case(setup.vary(changes) if changes else setup, span)

    return run
