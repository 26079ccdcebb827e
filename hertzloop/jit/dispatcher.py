"""A compiled function that gets an entry for Python only when Python calls it.

Numba makes such an entry for every function. That takes a third of the time of compiling, and most
kernels are called by other kernels alone.
"""

from typing import Any, ClassVar

from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature


class Kernel(CPUDispatcher):
    """A dispatcher whose overloads have no entry for Python while only kernels have called them.

    A call from Python compiles such an overload once more.
    """

    # These call each other: the first is called by Python.
    _compiling: ClassVar[list["Kernel"]] = []

    @classmethod
    def of(cls, dispatcher: CPUDispatcher) -> "Kernel":
        """The same dispatcher as a Kernel."""
        dispatcher.__class__ = cls
        dispatcher._begin()
        return dispatcher

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self._begin()

    def _begin(self) -> None:
        self._compiler._customize_flags = self._customized
        self._without_entry: set[Any] = set()

    def _customized(self, flags: Any) -> Any:
        if self.nested():
            flags.no_cpython_wrapper = True
        return flags

    @classmethod
    def nested(cls) -> bool:
        """Whether another kernel calls the one that is being compiled or loaded."""
        return len(cls._compiling) > 1

    def compile(self, sig: Any) -> Any:
        """Compile for argument types, or load what was compiled; returns the entry for Python."""
        with global_compiler_lock:
            arguments = tuple(normalize_signature(sig)[0])
            if arguments in self._without_entry and not self._compiling:
                self._without_entry.remove(arguments)
                del self.overloads[arguments]
            self._compiling.append(self)
            try:
                return super().compile(sig)
            finally:
                self._compiling.pop()

    def add_overload(self, result: Any) -> None:
        """Keep a compiled result; Python does not see one without an entry."""
        if self.nested():
            arguments = tuple(result.signature.args)
            self._without_entry.add(arguments)
            self.overloads[arguments] = result
        else:
            super().add_overload(result)
