"""Impacts cut out of a run's truth as they come, with their noise metrics."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from hertzloop.loop.impact_end import impact_follower
from hertzloop.plant.metrics import impact_kernels
from hertzloop.plant.metrics.impact_kernels import END, OVER, STEP
from hertzloop.plant.metrics.impacts import contacts, noise_inputs, part_of
from hertzloop.plant.metrics.noise import impact_noise
from hertzloop.plant.metrics.truth_kernels import ImpactSteps
from hertzloop.plant.plant import modes_of
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.time_series import COLUMNS, F_A, F_C, XI
from hertzloop.results import impact_windows
from hertzloop.results.impact_windows import BEHIND, ConsistentWindow, ImpactMetrics, ImpactWindow
from hertzloop.results.published_window import PublishedWindow
from hertzloop.scene.setup import Setup

Block = tuple[int, np.ndarray]  # first step, truth from there on, shape (10, steps)


def first_impact(
    setup: Setup, truth: np.ndarray, modes: Oscillators | None = None
) -> ImpactMetrics | None:
    """The first of `impacts_of_truth`, to the bit, in a fraction of the time; None without one."""
    if not SCHEMES[setup.run.scheme].conserves:
        return next(_published(setup, [(0, truth)]), None)
    lasts = impact_follower(setup)
    start = impact_kernels.follow_steps(lasts, truth[F_C], truth[F_A], truth[XI])
    count = int(lasts.counts[END])
    if start < 0:
        return None
    if count > impact_windows.PIECE:
        return next(impacts_of_blocks(setup, [(0, truth)], modes), None)
    spec, lead = setup.plant, min(start, 1)
    modes = modes or modes_of(spec)
    behind = BEHIND
    if lasts.counts[OVER]:  # the next impact counts with its first step, as in a window
        behind = min(behind, int(lasts.counts[STEP]) + 1 - count)
    truth = truth[:, start - lead : start + count + behind]
    part = part_of(spec, modes, truth, ImpactSteps(lead, count, first_step=start - lead))
    if not part.known:
        return None
    impact, end = part.impact(spec.step_s), lead + part.touching
    noise = impact_noise(spec, modes, noise_inputs(impact, part.drive, part.speed_max_m_s))
    return ImpactMetrics(
        start,
        start + part.touching,
        start + count,
        truth[F_C, lead:end],
        end < truth.shape[1],
        impact,
        noise,
    )


def impacts_of_truth(
    setup: Setup, truth: np.ndarray, modes: Oscillators | None = None
) -> list[ImpactMetrics]:
    """Impacts of a run from its truth, shape (10, steps).

    A contact that the run's end cuts off has the metrics of its part.
    """
    return list(impacts_of_blocks(setup, [(0, truth)], modes))


def impacts_of_blocks(
    setup: Setup, blocks: Iterable[Block], modes: Oscillators | None = None
) -> Iterator[ImpactMetrics]:
    """The same from steps that come in blocks, in the order of their steps; each impact as soon as
    the next one starts. Where steps are missing, a run ends and another begins. `modes`: those
    among which the energy is divided, if not all of the plate."""
    if not SCHEMES[setup.run.scheme].conserves:
        return _published(setup, blocks)
    spec = setup.plant

    def opened(start: int, before: np.ndarray | None) -> ImpactWindow:
        return ConsistentWindow(
            spec, modes or modes_of(spec), impact_follower(setup), start, before
        )

    return _cut(blocks, lambda truth: truth[F_C], opened)


def through_first_contact(blocks: Iterable[Block]) -> np.ndarray:
    """Truth, shape (10, steps), from the start of a run without holes to some steps after
    its first contact."""
    taken = [np.zeros((COLUMNS, 0))]
    touched = over = False
    for _, truth in blocks:
        taken.append(truth)
        if over:
            break
        touched = touched or bool(np.any(truth[F_C]))
        over = touched and truth[F_C, -1] == 0.0
    return np.concatenate(taken, axis=1)


def _published(setup: Setup, blocks: Iterable[Block]) -> Iterator[ImpactMetrics]:
    speeds = [setup.plant.sphere.impact_speed_m_s]
    # The published scheme starts a contact at xi = 0, where its force is still zero.
    return _cut(
        blocks,
        lambda truth: (truth[XI] <= 0.0).astype(float),
        lambda start, _: PublishedWindow(setup, speeds, start),
    )


def _cut(
    blocks: Iterable[Block],
    touching: Callable[[np.ndarray], np.ndarray],
    opened: Callable[[int, np.ndarray | None], ImpactWindow],
) -> Iterator[ImpactMetrics]:
    """Impacts of a run from its truth in blocks; where steps are missing, it begins anew.

    `touching` makes of steps (10, steps) values that are zero where there is no contact; `opened`
    makes the window of an impact from its first step and the row before, shape (10, 1), None at
    the beginning.
    """
    window: ImpactWindow | None = None
    before: np.ndarray | None = None
    expected = 0
    for first, truth in blocks:
        if not truth.shape[1]:
            continue
        if first != expected:
            yield from _closed(window, None)
            window = before = None
        at, starts = 0, contacts(touching(truth))[0]
        if starts[:1] == [0] and before is not None and touching(before)[0]:
            del starts[0]
        for start in starts:
            if window:
                window.feed(truth[:, at:start])
                yield from _closed(window, truth[:, start : start + 1])
            window = opened(first + start, truth[:, start - 1 : start] if start else before)
            at = start
        if window:
            window.feed(truth[:, at:])
        before, expected = truth[:, -1:].copy(), first + truth.shape[1]
    yield from _closed(window, None)


def _closed(window: ImpactWindow | None, following: np.ndarray | None) -> Iterator[ImpactMetrics]:
    found = window.close(following) if window else None
    if found:
        yield found
