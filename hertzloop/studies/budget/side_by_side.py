"""Searches of several limits that run their cases together."""

from collections.abc import Callable, Sequence

from hertzloop.studies.budget.limit_search import Asks
from hertzloop.studies.budget.limits import BudgetLimit
from hertzloop.studies.cases.rows import Case, Rows, RunCases


def side_by_side(
    searches: Sequence[Asks],
    run: RunCases,
    on_round: Callable[[int], None] = lambda finished: None,
) -> list[BudgetLimit]:
    """Advance several searches together, so that all cores have work.

    Args:
        searches: Generators as of `limit_of`.
        run: Returns the rows of cases, in their order.
        on_round: Is told after each round how many searches have finished.

    Returns:
        The limits, in the order of the searches.
    """
    found: dict[int, BudgetLimit] = {}
    asked: dict[int, list[Case]] = {}

    def advance(number: int, rows: Rows | None) -> None:
        try:
            search = searches[number]
            asked[number] = next(search) if rows is None else search.send(rows)
        except StopIteration as end:
            asked.pop(number, None)
            found[number] = end.value

    for number in range(len(searches)):
        advance(number, None)
    while asked:
        numbers = list(asked)
        rows = run([case for number in numbers for case in asked[number]])
        at = 0
        for number in numbers:
            count = len(asked[number])
            advance(number, rows[at : at + count])
            at += count
        on_round(len(found))
    return [found[number] for number in range(len(searches))]
