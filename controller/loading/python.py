"""Laws written in Python: from a file, or from a module that can be imported."""

import importlib
import importlib.util
import sys
import sysconfig
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from hertzloop.common.text_files import python_text
from hertzloop.controller.loading import callbacks
from hertzloop.controller.loading.callbacks import LawTimeout, given_up_in_time
from hertzloop.controller.loading.identity import TEXT_DIGITS, identify
from hertzloop.controller.loading.interface import check_home
from hertzloop.controller.loading.law import Law, LawError, error_text


def file_law(path: Path, name: str | None, text: str) -> Law:
    """The law in a file, or in its class `name`; `text` is the digest of its files. Raises
    LawError."""
    module = ModuleType(f"hertzloop_file_{path.stem}_{text}")
    module.__file__ = str(path)
    source, folder = python_text(path.read_bytes()), str(path.parent)

    def execute() -> ModuleType:
        sys.modules[module.__name__] = module
        added = [] if folder in sys.path else [folder]
        sys.path += added
        try:
            exec(compile(source, str(path), "exec"), module.__dict__)
        finally:
            for entry in added:
                sys.path.remove(entry)
        return module

    return _law(f"{path.name}:{name}" if name else path.name, path, name, text, execute)


def module_law(reference: str, module: str, path: Path, name: str | None, text: str) -> Law:
    """The law in a module, or in its class `name`. Raises LawError."""
    return _law(reference, path, name, text, lambda: importlib.import_module(module))


def module_path(reference: str, module: str) -> Path:
    """The file of a module. Raises LawError."""
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError) as error:
        raise LawError(f"controller.law = '{reference}': {error}") from error
    if spec is None or not spec.origin or not spec.origin.endswith(".py"):
        raise LawError(
            f"controller.law = '{reference}': the Python module {module} was not found. Install it."
        )
    return Path(spec.origin)


def _law(
    label: str, path: Path, name: str | None, text: str, load: Callable[[], ModuleType]
) -> Law:
    try:
        with given_up_in_time(), _own_modules_anew():
            home: Any = load()
    except LawTimeout:
        raise LawError(
            f"law {path}: was not loaded within {callbacks.PATIENCE_S:g} s. Check it for an "
            "endless loop."
        ) from None
    except (Exception, SystemExit) as error:
        raise LawError(f"law {path}: cannot be loaded: {error_text(error, path)}") from error
    if name:
        home = getattr(home, name, None)
        if home is None:
            raise LawError(
                f"controller.law: {path} does not define {name}. Define it or change the name."
            )
    check_home(label, home)
    identity, source = identify(home), python_text(path.read_bytes())
    return Law(label, path, source, text[:TEXT_DIGITS] + identity.digest, home, identity)


_own_modules: set[str] = set()  # that laws have imported


@contextmanager
def _own_modules_anew() -> Iterator[None]:
    """Import what belongs to a law anew, as it is now; what is imported before any law did stays as
    it is: `importlib.reload` reads that again."""
    importlib.invalidate_caches()
    before = {name: sys.modules.pop(name) for name in _own_modules & sys.modules.keys()}
    known, writes = set(sys.modules), sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # bytecode does not tell two edits of a second apart
    try:
        yield
    finally:
        sys.dont_write_bytecode = writes
        imported = sys.modules.keys() - known
        _own_modules.update(name for name in imported if _is_own(sys.modules[name]))
        for name, module in before.items():  # laws that were loaded before may still need it
            sys.modules.setdefault(name, module)


_INSTALLED = tuple(
    sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")
)


def _is_own(module: ModuleType) -> bool:
    """Whether a module is neither installed nor part of hertzloop."""
    if module.__name__.partition(".")[0] == "hertzloop":
        return False
    file = getattr(module, "__file__", None) or next(iter(getattr(module, "__path__", [])), "")
    return bool(file) and not file.endswith(".so") and not file.startswith(_INSTALLED)
