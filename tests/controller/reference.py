"""The laws once more in plain Python, from the sentences that define them, without a state
machine: the run is told contact by contact."""

from collections.abc import Callable, Sequence

IDLE, WATCHING, ACTING, SPENT = range(4)

Row = tuple[int, float]  # mode after a sample, its command


def _start_of_contact(touching: Sequence[bool], i: int) -> int:
    while i > 0 and touching[i - 1]:
        i -= 1
    return i


def slope_threshold(
    samples: Sequence[float],
    factor: float,
    v_thr: float,
    level: float = 0.0,
    on_latch: Callable[[int, int], None] = lambda at, delay: None,
) -> list[Row]:
    """Modes and commands for one sample a second, `factor` = kappa s."""
    n = len(samples)
    touching = [x <= level for x in samples]
    rows: list[Row] = []

    def rises(i: int) -> bool:
        return i > 0 and samples[i] - samples[i - 1] > v_thr

    while len(rows) < n:
        i = len(rows)
        if not touching[i]:
            rows.append((IDLE, 0.0))
            continue
        while i < n and touching[i] and not rises(i):
            rows.append((WATCHING, 0.0))
            i += 1
        if i == n or not touching[i]:
            continue
        delay = i - _start_of_contact(touching, i)
        on_latch(i, delay)
        while i < n and touching[i - delay]:
            rows.append((ACTING, factor * max(0.0, -samples[i - delay]) ** 1.5))
            i += 1
        if i < n:  # the sample at which the stored contact is over is not judged again
            rows.append((WATCHING if touching[i] else IDLE, 0.0))
    return rows


def profile(samples: Sequence[float], forces: Sequence[float], level: float = 0.0) -> list[Row]:
    """Modes and commands of a force profile started by the first sample of a contact."""
    n = len(samples)
    touching = [x <= level for x in samples]
    rows: list[Row] = []
    while len(rows) < n:
        if not touching[len(rows)]:
            rows.append((IDLE, 0.0))
            continue
        rows += [(ACTING, force) for force in forces][: n - len(rows)]
        while len(rows) < n and touching[len(rows)]:
            rows.append((SPENT, 0.0))
    return rows
