"""Which test files to run on a mutant: near ones first, by who imports it, then quick ones."""

import ast
from collections.abc import Callable
from functools import cache
from pathlib import Path

# Fail for the form of a mutant, whatever it does; and run this command.
_LEFT_OUT = ("tests/test_checks.py", "tests/mutants/")
_GUESS_S = 10.0  # processor time of a test file that has not been timed yet
_LINKED = ("common", "plant", "sensors", "controller", "bus", "recordings")
_NEAR = 2  # imports: directly, or through one other module


def test_files(root):
    """All files of tests."""
    found = (path.relative_to(root).as_posix() for path in (root / "tests").rglob("test_*.py"))
    return sorted(path for path in found if not path.startswith(_LEFT_OUT))


def distances(root: Path, module: str) -> dict[str, int]:
    """By how many imports the files that import `module`, a path too, are from it."""
    importers = _importers(root)
    found, edge = {module: 0}, [module]
    for path in edge:
        for one in importers.get(path, ()):
            if one not in found:
                found[one] = found[path] + 1
                edge.append(one)
    return found


def ranks(root: Path, module: str) -> dict[str, int]:
    """Test files by how likely they notice a change of `module`, 0 the likeliest."""
    near = distances(root, module)
    mirrored = _mirror(root, module)

    def rank(test: str) -> int:
        ours, away = test.startswith(mirrored), near.get(test, _NEAR + 1)
        if away <= _NEAR:
            return away - 1 if ours else _NEAR + away - 1
        return 2 * _NEAR + (not ours and test not in near)  # the last as a child, perhaps

    return {test: rank(test) for test in test_files(root)}


def chosen(
    root: Path,
    module: str,
    near: bool,
    seconds: dict[str, float | None],
    measure: Callable[[str], float | None],
    most_s: float,
) -> list[str]:
    """The tests for a mutant of `module`, in order, that take `most_s` seconds together: those
    that are `near`, or the others.

    `seconds` each file is known to take, None if it fails without any mutant; `measure` finds out
    what is not known yet.
    """
    order = {test: rank for test, rank in ranks(root, module).items() if (rank < _NEAR) == near}
    files, total = [], 0.0
    for test in sorted(order, key=lambda test: (order[test], seconds.get(test) or _GUESS_S, test)):
        if total + (seconds.get(test) or 0.0) > most_s:
            continue
        if test not in seconds:
            seconds[test] = measure(test)
        took = seconds[test]
        if took is not None and total + took <= most_s:
            files.append(test)
            total += took
        if total > 0.9 * most_s:
            break
    return sorted(files, key=lambda test: (order[test], seconds[test] or 0.0))


def _mirror(root: Path, module: str) -> str:
    """The folder of tests that mirrors a module's: as tests/fitting/fit/ and tests/bus/."""
    parts = module.split("/")[:-1]
    for size in range(len(parts), 0, -1):
        inner, outer = "/".join(parts[:size]), "/".join(parts[1:size])
        for folder in (f"tests/{inner}", f"tests/{outer}"):
            if folder != "tests/" and (root / folder).is_dir():
                return f"{folder}/"
    return f"tests/{parts[0]}/"


@cache
def _importers(root: Path) -> dict[str, set[str]]:
    """Who imports a file, by path."""
    paths = [path.relative_to(root).as_posix() for path in root.rglob("*.py")]
    names = {_import_name(path): path for path in paths}
    found: dict[str, set[str]] = {}
    for path in paths:
        for name in _imported((root / path).read_text()):
            if name in names:
                found.setdefault(names[name], set()).add(path)
    return found


def _import_name(path: str) -> str:
    """What a file is imported as; folders beside `hertzloop` that it links to are parts of it."""
    name = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    return f"hertzloop.{name}" if name.split(".")[0] in _LINKED else name


def _imported(text: str) -> set[str]:
    """Names that a file imports, within functions too; of `from a import b` both a and a.b."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
    return found
