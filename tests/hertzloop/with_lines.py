"""Our modules with a line more in their text, as somebody would write it who adds something."""

import sys
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from pathlib import Path


def with_line(name: str, before: str, line: str) -> None:
    """Load a module that nothing has imported yet with `line` before the text `before`."""
    if name in sys.modules:
        raise RuntimeError(f"{name} was imported without the line")
    spec = find_spec(name)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(name)
    text = Path(spec.origin).read_text(encoding="utf-8")
    if text.count(before) != 1:
        raise RuntimeError(f"{name} has {text.count(before)} times {before!r}")
    module = module_from_spec(spec)
    sys.modules[name] = module
    exec(compile(text.replace(before, line + before), spec.origin, "exec"), module.__dict__)
    folder, _, own = name.rpartition(".")
    setattr(import_module(folder), own, module)
