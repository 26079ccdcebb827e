"""Simulate cases of a scene: one case, a chunk that a worker takes, or all cases in a pool."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from hertzloop.loop.simulate import LawStopped
from hertzloop.results.cases import (
    CASE_FACTS,
    CaseFailed,
    CaseState,
    UnstableLoop,
    metrics_of_case,
)
from hertzloop.results.spans import Span
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse
from hertzloop.scene.toml import to_toml
from hertzloop.studies.cases.rows import Case, Row, Rows, without_result

_CHUNK = 16  # cases in a chunk: about 5 ms of work

Numbered = list[tuple[int, Case]]
Pool = Callable[[str, Span, list[Numbered]], Iterator[Rows]]


_parsed = lru_cache(maxsize=4)(parse)


def scene_of(toml: str) -> Setup:
    """Return the setup of a scene text; the same object for the same text, whose cached parts are
    then found faster. A law that is not shipped is loaded again, since its file may have changed.
    """
    setup = _parsed(toml)
    return setup if setup.scene.controller.law_is_shipped else parse(toml)


def run_chunk(scene_toml: str, span: Span, numbered: Numbered) -> Rows:
    """Return the rows of a chunk of cases of a scene text; see `run_cases`."""
    return run_cases(scene_of(scene_toml), span, numbered)


def run_cases(setup: Setup, span: Span, numbered: Numbered) -> Rows:
    """Return the rows of cases.

    A row has the number of the case, the varied keys, the metrics, `state` as in `CaseState`, and
    `status`: a sentence on why there are no metrics, else empty. A case that fails has such a
    sentence, and the others go on. A case is "not run" if the scene or the law refuses its values,
    and "failed" if the law raises an exception in the run, or the program does.
    """
    return [run_case(setup, span, *case) for case in numbered]


def run_case(setup: Setup, span: Span, number: int, values: Case) -> Row:
    """Return the row of one case; see `run_cases`."""
    row: Row = {"case": number, **values}
    try:
        metrics = metrics_of_case(setup.vary(values), span)
        return row | vars(metrics) | {"status": "", "state": CaseState.METRICS.value}
    except Exception as error:  # one case must not end the others
        status = str(error) if isinstance(error, SceneError) else f"failed: {error!r}"
        return row | dict.fromkeys(CASE_FACTS) | {"status": status, "state": _state(error).value}


def _state(error: Exception) -> CaseState:
    """What became of a case that raised an error."""
    if isinstance(error, UnstableLoop):
        return CaseState.UNSTABLE
    refused = isinstance(error, SceneError) and not isinstance(error, LawStopped | CaseFailed)
    return CaseState.NOT_RUN if refused else CaseState.FAILED


@dataclass
class CaseTally:
    """Number of the cases that were run, and the rows of those without a result."""

    cases: int = 0
    without_result: Rows = field(default_factory=list)

    def counting(self, pool: Pool) -> Pool:
        """Return a pool that counts its cases."""

        def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
            for rows in pool(toml, span, chunks):
                self.cases += len(rows)
                self.without_result += without_result(rows)
                yield rows

        return results


def chunked(numbered: Numbered) -> list[Numbered]:
    """Return the chunks of cases."""
    return [numbered[i : i + _CHUNK] for i in range(0, len(numbered), _CHUNK)]


def evaluate(pool: Pool, setup: Setup, span: Span, cases: list[Case]) -> Rows:
    """Return the rows of all cases, in their order."""
    chunks = chunked(list(enumerate(cases)))
    rows = [row for some in pool(to_toml(setup.scene), span, chunks) for row in some]
    return sorted(rows, key=lambda row: int(row["case"]))
