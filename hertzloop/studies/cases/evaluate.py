"""Simulate cases of a scene: one case, a chunk that a worker takes, or all cases in a pool."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from hertzloop.results.cases import (
    CASE_METRICS,
    CaseState,
    Span,
    UnstableLoop,
    metrics_of_case,
)
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse
from hertzloop.scene.toml import to_toml
from hertzloop.studies.worst.of_case import WORST_OF, worst_columns, worst_of_case

_CHUNK = 16  # cases in a chunk: about 5 ms of work

Case = dict[str, Any]  # values by scene key
Numbered = list[tuple[int, Case]]
Rows = list[dict[str, Any]]
Run = Callable[[list[Case]], Rows]  # rows of cases, in their order
Pool = Callable[[str, Span, list[Numbered]], Iterator[Rows]]


_parsed = lru_cache(maxsize=4)(parse)


def scene_of(toml: str) -> Setup:
    """Return the setup of a scene text; the same object for the same text, whose cached parts are
    then found faster. A law that is not shipped is loaded again, since its file may have changed.
    """
    setup = _parsed(toml)
    return setup if setup.law_is_shipped else parse(toml)


def run_chunk(scene_toml: str, span: Span, numbered: Numbered) -> Rows:
    """Return the rows of a chunk of cases."""
    return list(run_cases(scene_of(scene_toml), span, numbered))


def run_cases(setup: Setup, span: Span, numbered: Numbered) -> Iterator[dict[str, Any]]:
    """Yield the rows of cases.

    A row has the number of the case, the varied keys, the metrics, `state` as in `CaseState`, and
    `status`: a sentence on why there are no metrics, else empty. A case that fails has such a
    sentence, and the others go on. The values of a case are scene keys; with a metric under
    `WORST_OF` among them, its row has the columns of `worst_of_case`, too.
    """
    return (run_case(setup, span, *case) for case in numbered)


def run_case(setup: Setup, span: Span, number: int, values: dict[str, Any]) -> dict[str, Any]:
    """Return the row of one case; see `run_cases`."""
    keys = {key: value for key, value in values.items() if key != WORST_OF}
    row: dict[str, Any] = {"case": number, **keys}
    try:
        metrics = metrics_of_case(setup.vary(keys), span)
        row |= vars(metrics) | {"status": "", "state": CaseState.METRICS.value}
    except Exception as error:  # one case must not end the others
        status = str(error) if isinstance(error, SceneError) else f"failed: {error!r}"
        state = CaseState.UNSTABLE if isinstance(error, UnstableLoop) else CaseState.NOT_RUN
        row |= dict.fromkeys(CASE_METRICS) | {"status": status, "state": state.value}
    if WORST_OF not in values:
        return row
    if row["state"] == CaseState.NOT_RUN:
        return row | dict.fromkeys(worst_columns(values[WORST_OF]))
    metric = values[WORST_OF]
    try:
        varied = setup.vary(keys)
        return row | worst_of_case(
            varied, metric, lambda cases: list(run_cases(varied, span, [*enumerate(cases)]))
        )
    except Exception as error:
        return row | dict.fromkeys(worst_columns(metric)) | {"status": f"failed: {error!r}"}


def not_run(rows: Rows) -> Rows:
    """Return the rows of cases that could not be run. An unstable case was run."""
    return [row for row in rows if row["state"] == CaseState.NOT_RUN]


def older_state(status: str | None) -> str:
    """Return the state of a case from results of a version that wrote `status` only."""
    if not status:
        return CaseState.METRICS.value
    unstable = status.startswith("the closed loop is unstable")
    return (CaseState.UNSTABLE if unstable else CaseState.NOT_RUN).value


@dataclass
class CaseTally:
    """Number of the cases that were run, and the rows of those that could not be run."""

    cases: int = 0
    not_run: Rows = field(default_factory=list)

    def of(self, pool: Pool) -> Pool:
        """Return a pool that counts its cases."""

        def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
            for rows in pool(toml, span, chunks):
                self.cases += len(rows)
                self.not_run += not_run(rows)
                yield rows

        return results


def chunked(numbered: Numbered) -> list[Numbered]:
    """Return the chunks of cases. A case with a search takes seconds, and is a chunk by itself."""
    some = 1 if any(WORST_OF in values for _, values in numbered) else _CHUNK
    return [numbered[i : i + some] for i in range(0, len(numbered), some)]


def evaluate(pool: Pool, setup: Setup, span: Span, cases: list[dict[str, Any]]) -> Rows:
    """Return the rows of all cases, in their order."""
    chunks = chunked(list(enumerate(cases)))
    rows = [row for some in pool(to_toml(setup.scene), span, chunks) for row in some]
    return sorted(rows, key=lambda row: int(row["case"]))
