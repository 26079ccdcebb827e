"""What follows from some tables of a scene, worked out once for all scenes that share these.

The cases of a sweep differ in a few keys; most of what is made of a scene is the same for all.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import lru_cache, wraps
from operator import attrgetter
from typing import Concatenate, ParamSpec, TypeVar

from hertzloop.scenes.scene import Scene

_KEPT = 8  # a table of modes can be large

Result = TypeVar("Result")
More = ParamSpec("More")


@dataclass(frozen=True)
class _Scene:
    """A scene, known by what it shares."""

    shared: Hashable
    scene: Scene = field(compare=False)


def by_tables(
    *names: str,
) -> Callable[
    [Callable[Concatenate[Scene, More], Result]], Callable[Concatenate[Scene, More], Result]
]:
    """Keep the results of a function of a scene by the tables, or "table.key", that it reads, and
    by what else it is given."""
    shared = attrgetter(*names)

    def keeping(
        function: Callable[Concatenate[Scene, More], Result],
    ) -> Callable[Concatenate[Scene, More], Result]:
        @lru_cache(maxsize=_KEPT)
        def known(given: _Scene, *more: More.args, **named: More.kwargs) -> Result:
            return function(given.scene, *more, **named)

        @wraps(function)
        def kept(scene: Scene, *more: More.args, **named: More.kwargs) -> Result:
            return known(_Scene(shared(scene), scene), *more, **named)  # type: ignore[arg-type]

        return kept

    return keeping
