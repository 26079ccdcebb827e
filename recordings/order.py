"""The order of a file's parts where they have changed places."""

import heapq
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise


def in_order(numbers: Sequence[Mapping[str, int]]) -> list[int]:
    """Positions of parts so that the messages of every stream follow one another; else as they are.

    `numbers` has, for each part, the first number of every stream in it. Where no order suits all
    streams, as only a forged file has it, the part that comes first in the file is taken.
    """
    by_stream: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for position, first in enumerate(numbers):
        for stream, number in first.items():
            by_stream[stream].append((number, position))
    after: dict[int, list[int]] = defaultdict(list)
    waits = [0] * len(numbers)  # for how many others a part has to wait
    for of_stream in by_stream.values():
        of_stream.sort()
        for (_, position), (_, follows) in pairwise(of_stream):
            after[position].append(follows)
            waits[follows] += 1
    ready = [position for position, count in enumerate(waits) if not count]
    order: list[int] = []
    taken = [False] * len(numbers)
    first_left = 0
    while len(order) < len(numbers):
        if ready:
            position = heapq.heappop(ready)
        else:  # a circle
            while taken[first_left]:
                first_left += 1
            position = first_left
        if taken[position]:
            continue
        taken[position] = True
        order.append(position)
        for follows in after[position]:
            waits[follows] -= 1
            if not waits[follows]:
                heapq.heappush(ready, follows)
    return order
