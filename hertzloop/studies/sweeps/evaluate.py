"""Simulate many cases of a scene: one, some that travel together, all of them."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from hertzloop.results.cases import (
    CASE_METRICS,
    CaseState,
    Span,
    UnstableLoop,
    case_in_parts,
    together,
)
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse
from hertzloop.scene.toml import to_toml
from hertzloop.studies.worst.of_case import WORST_OF, worst_columns, worst_of_case

_CHUNK = 16  # cases that travel together, and are formed in step: some 5 ms of work
_BESIDE_PLANT = ("controller.", "sensors.", "run.touch_phase", "run.seed")

Numbered = list[tuple[int, dict[str, Any]]]
Rows = list[dict[str, Any]]
Pool = Callable[[str, Span, list[Numbered]], Iterator[Rows]]


_parsed = lru_cache(maxsize=4)(parse)


def scene_of(toml: str) -> Setup:
    """A scene from its text, for the same text the same: what is kept by tables is found faster.
    But the file of a law from elsewhere may be another one by now."""
    setup = _parsed(toml)
    return setup if setup.law_is_shipped else parse(toml)


def run_chunk(scene_toml: str, span: Span, numbered: Numbered) -> Rows:
    """Simulate some cases, in whatever process; a row each."""
    return list(run_cases(scene_of(scene_toml), span, numbered))


def run_cases(setup: Setup, span: Span, numbered: Numbered) -> Iterator[dict[str, Any]]:
    """Rows of cases as they come: their number, the varied keys, the metrics, `status`, a sentence
    on why there are none, empty if all is well, and `state`, as in `CaseState`.

    The values of a case are scene keys. With a metric under `WORST_OF` among them its row has the
    columns of `worst_of_case`, too."""
    alike = all(key.startswith(_BESIDE_PLANT) for _, values in numbered for key in values)
    some = _CHUNK if alike else 1  # plants of several cases would not all be kept
    for at in range(0, len(numbered), some):
        yield from together([_row(setup, span, *case) for case in numbered[at : at + some]])


def _row(
    setup: Setup, span: Span, number: int, values: dict[str, Any]
) -> Generator[None, None, dict[str, Any]]:
    keys = {key: value for key, value in values.items() if key != WORST_OF}
    row: dict[str, Any] = {"case": number, **keys}
    try:
        metrics = yield from case_in_parts(setup.vary(keys), span)
        row |= vars(metrics) | {"status": "", "state": CaseState.METRICS.value}
    except Exception as error:  # one case must not end the others
        status = str(error) if isinstance(error, SceneError) else f"failed: {error!r}"
        state = CaseState.UNSTABLE if isinstance(error, UnstableLoop) else CaseState.NOT_RUN
        row |= dict.fromkeys(CASE_METRICS) | {"status": status, "state": state.value}
    if WORST_OF not in values:
        return row
    if row["state"] == CaseState.NOT_RUN:
        return row | dict.fromkeys(worst_columns(values[WORST_OF]))
    varied = setup.vary(keys)
    return row | worst_of_case(
        varied, values[WORST_OF], lambda cases: list(run_cases(varied, span, [*enumerate(cases)]))
    )


def run_case(setup: Setup, span: Span, number: int, values: dict[str, Any]) -> dict[str, Any]:
    """The row of one case."""
    return next(run_cases(setup, span, [(number, values)]))


def not_run(rows: Rows) -> Rows:
    """Rows of cases that could not be run; one that is unstable was, though it has no metrics."""
    return [row for row in rows if row["state"] == CaseState.NOT_RUN]


def older_state(status: str | None) -> str:
    """The state of a case from results of a version that wrote `status` alone."""
    if not status:
        return CaseState.METRICS.value
    unstable = status.startswith("the closed loop is unstable")
    return (CaseState.UNSTABLE if unstable else CaseState.NOT_RUN).value


@dataclass
class CaseTally:
    """How many cases were asked for, and the rows of those that could not be run."""

    cases: int = 0
    not_run: Rows = field(default_factory=list)

    def of(self, pool: Pool) -> Pool:
        """The same pool, counted."""

        def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
            for rows in pool(toml, span, chunks):
                self.cases += len(rows)
                self.not_run += not_run(rows)
                yield rows

        return results


def chunked(numbered: Numbered) -> list[Numbered]:
    """Cases in the portions that travel together; those with a search, which takes seconds, each
    by itself."""
    some = 1 if any(WORST_OF in values for _, values in numbered) else _CHUNK
    return [numbered[i : i + some] for i in range(0, len(numbered), some)]


def evaluate(pool: Pool, setup: Setup, span: Span, cases: list[dict[str, Any]]) -> Rows:
    """Rows of all cases, in their order."""
    chunks = chunked(list(enumerate(cases)))
    rows = [row for some in pool(to_toml(setup.scene), span, chunks) for row in some]
    return sorted(rows, key=lambda row: int(row["case"]))
