"""A compiled function whose part in other compiled functions is cheap to make.

Most kernels are called by other kernels alone. Numba makes for every function optimised code,
machine code and an entry for Python, and then compiles what its callers have linked in once more.
A kernel that another kernel calls has none of these here: its code is optimised within its callers.
"""

import gc
from typing import Any, ClassVar

from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher


class PartOfCallers(JITCodeLibrary):
    """Code of a kernel as Numba has lowered it, for callers to link in."""

    def finalize(self) -> None:
        """Link in the code of what it calls; nothing is optimised yet."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True


class Kernel(CPUDispatcher):
    """A dispatcher that compiles to machine code only what Python calls.

    What Python calls and what other kernels link in are compiled apart, even for the same argument
    types. Otherwise the code of a caller would depend on what a process had compiled before it: a
    part that was optimised already is rounded in other places than one that is not.

    Attributes:
        parts: Compiled results that other kernels link in, by argument types.
    """

    # These call each other: the first is called by Python.
    _compiling: ClassVar[list["Kernel"]] = []
    _cache: Any

    @classmethod
    def of(cls, dispatcher: CPUDispatcher) -> "Kernel":
        """The same dispatcher as a Kernel."""
        dispatcher.__class__ = cls
        dispatcher.overloads = vars(dispatcher).pop("overloads")
        dispatcher._compiler._customize_flags = dispatcher._customized
        return dispatcher

    @property
    def overloads(self) -> dict[Any, Any]:
        """Compiled results by argument types: those for Python, or while another kernel is being
        compiled, those that it links in."""
        compiling = self._compiling
        return self.parts if compiling and compiling[0] is not self else self._entries

    @overloads.setter
    def overloads(self, entries: dict[Any, Any]) -> None:
        self._entries = entries
        self.parts: dict[Any, Any] = {}

    def _customized(self, flags: Any) -> Any:
        if self.nested():
            flags.no_cpython_wrapper = flags.no_compile = True
        return flags

    @classmethod
    def nested(cls) -> bool:
        """Whether another kernel calls the one that is being compiled."""
        return len(cls._compiling) > 1

    def compile(self, sig: Any) -> Any:
        """Compile for argument types, or load what was compiled; returns the entry for Python."""
        with global_compiler_lock:
            self._compiling.append(self)
            cache, collecting = self._cache, gc.isenabled()
            # Most of what is made here lives long: to look for garbage takes 8 % of the time.
            gc.disable()
            try:
                if self.nested():  # neither kept on the disk nor loaded
                    self._cache = NullCache()
                return super().compile(sig)
            finally:
                self._cache = cache
                self._compiling.pop()
                if collecting:
                    gc.enable()

    def recompile(self) -> None:
        """Compile again for all argument types, with the values that globals have now."""
        self.parts.clear()
        super().recompile()

    def add_overload(self, result: Any) -> None:
        """Keep a compiled result; Python does not see a part of others."""
        if not self.nested():
            super().add_overload(result)
            return
        result.library.__class__ = PartOfCallers
        key = object()  # callers find the code by it, as by an entry
        self.targetctx.insert_user_function(key, result.fndesc, [result.library])
        self.overloads[tuple(result.signature.args)] = result._replace(entry_point=key)
