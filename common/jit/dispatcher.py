"""A compiled function whose part in other compiled functions is cheap to make.

Most kernels are called by other kernels alone. Numba makes for every function optimised code,
machine code and an entry for Python, and then compiles what its callers have linked in once more.
A kernel that another kernel calls has none of these here: its code is optimised within its callers.
"""

from typing import Any, ClassVar

from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature


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

    A call from Python of a kernel that was compiled as a part of others compiles it once more.
    """

    # These call each other: the first is called by Python.
    _compiling: ClassVar[list["Kernel"]] = []
    _cache: Any

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
        self._parts: set[Any] = set()

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
            arguments = tuple(normalize_signature(sig)[0])
            if arguments in self._parts and not self._compiling:
                self._parts.remove(arguments)
                del self.overloads[arguments]
            self._compiling.append(self)
            cache, nested = self._cache, self.nested()
            try:
                if nested:  # neither kept on the disk nor loaded
                    self._cache = NullCache()
                return super().compile(sig)
            finally:
                self._cache = cache
                self._compiling.pop()

    def recompile(self) -> None:
        """Compile again for all argument types, with the values that globals have now."""
        self._parts.clear()
        super().recompile()

    def add_overload(self, result: Any) -> None:
        """Keep a compiled result; Python does not see a part of others."""
        if not self.nested():
            super().add_overload(result)
            return
        arguments = tuple(result.signature.args)
        result.library.__class__ = PartOfCallers
        key = object()  # callers find the code by it, as by an entry
        self.targetctx.insert_user_function(key, result.fndesc, [result.library])
        self._parts.add(arguments)
        self.overloads[arguments] = result._replace(entry_point=key)
