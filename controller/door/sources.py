"""The text of a law and its digest, from the disk, before anything of it is executed."""

import ast
import hashlib
import shlex
from pathlib import Path

SHIPPED = Path(__file__).resolve().parent.parent / "laws"  # the laws that come with hertzloop


def compilation(path: Path) -> str:
    """The command that makes a library beside a law's source text in C."""
    compiler = "cc" if path.suffix == ".c" else "c++"
    source, library = shlex.quote(str(path)), shlex.quote(str(path.with_suffix(".so")))
    return f"{compiler} -O2 -fPIC -shared -ffp-contract=off {source} -o {library} -lm"


def digest_of(path: Path) -> str:
    """Digest of a law's file and, for Python, of all files beside it and shipped laws that it
    imports.

    Raises OSError, SyntaxError or UnicodeDecodeError.
    """
    total = hashlib.sha256()
    for file in _files(path) if path.suffix == ".py" else [path]:
        content = file.read_bytes()
        total.update(f"{file.name} {len(content)}\n".encode() + content)
    return total.hexdigest()[:32]


def _files(path: Path) -> list[Path]:
    """A file and those of its folder, or shipped ones, that it imports, directly or not."""
    found, open_ = {path}, [path]
    while open_:
        file = open_.pop()
        for name in _imported(ast.parse(file.read_text(encoding="utf-8"), str(file))):
            for folder in (path.parent, SHIPPED):
                used = folder / f"{name}.py"
                if used not in found and used.is_file():
                    found.add(used)
                    open_.append(used)
    return [path, *sorted(found - {path}, key=lambda file: file.name)]


def _imported(tree: ast.Module) -> set[str]:
    """Last words of all imported names: a module of the same folder is among them if at all."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {node.module or "", *(alias.name for alias in node.names)}
    return {name.rpartition(".")[2] for name in names}
