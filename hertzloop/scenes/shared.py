"""What follows from some tables of a scene, worked out once for all scenes that share these.

The cases of a sweep differ in a few keys; most of what is made of a scene is the same for all.
"""

from collections.abc import Callable, Hashable
from functools import wraps
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

if TYPE_CHECKING:
    from hertzloop.scenes.scene import Scene

_KEPT = 8  # a table of modes can be large

Result = TypeVar("Result")
More = ParamSpec("More")


def by_tables(
    *names: str,
) -> Callable[
    [Callable[Concatenate["Scene", More], Result]], Callable[Concatenate["Scene", More], Result]
]:
    """Keep the results of a function of a scene by the tables, or "table.key", that it reads, and
    by what else it is given; those that were made last."""
    shared: Callable[[Scene], Hashable] = attrgetter(*names)

    def keeping(
        function: Callable[Concatenate["Scene", More], Result],
    ) -> Callable[Concatenate["Scene", More], Result]:
        known: dict[Hashable, Any] = {}

        @wraps(function)
        def kept(scene: "Scene", *more: More.args, **named: More.kwargs) -> Result:
            key = (shared(scene), more, *named.items())
            found = known.get(key, known)  # None may be a result
            if found is known:
                found = function(scene, *more, **named)
                while len(known) >= _KEPT:
                    known.pop(next(iter(known), None), None)
                known[key] = found
            return found

        return kept

    return keeping
