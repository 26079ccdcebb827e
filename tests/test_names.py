"""One name, one thing: what a name means does not depend on the file that it stands in."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

from hertzloop.controller.loading.registry import shipped
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.structures.registry import STRUCTURES

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("hertzloop", "common", "plant", "sensors", "controller", "bus", "recordings")
INTERFACE = {"Parameters", "State", "Constants"}  # what a law defines, see docs/how-to/laws.md


def product() -> dict[str, ast.Module]:
    """Syntax trees of all modules by path."""
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")]
    inside = [file for file in files if file.resolve() == file]  # not by the links
    return {str(file.relative_to(ROOT)): ast.parse(file.read_text()) for file in inside}


PRODUCT = product()
MODULES = {path.removesuffix(".py").replace("/", ".") for path in PRODUCT}


def test_a_class_name_is_defined_once():
    found = defaultdict(list)
    for path, tree in PRODUCT.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not (
                path.startswith("controller/laws/") and node.name in INTERFACE
            ):
                found[node.name].append(f"{path}:{node.lineno}")
    assert len(found) > 300
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


def test_an_alias_means_one_thing():
    """A module, or what is imported under another name, has one name in the whole product."""
    found = defaultdict(set)
    for tree in PRODUCT.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                for name in node.names:
                    if name.asname:
                        found[name.name].add(name.asname)
            elif isinstance(node, ast.ImportFrom):
                for name in node.names:
                    full = f"{node.module}.{name.name}"
                    renamed = name.asname not in (None, name.name)  # `x as x` exports x
                    if renamed or MODULES & {full, full.removeprefix("hertzloop.")}:
                        found[full].add(name.asname or name.name)
    aliases = [alias for names in found.values() for alias in names]
    assert len(aliases) > 50
    assert {full: names for full, names in found.items() if len(names) > 1} == {}
    assert sorted({alias for alias in aliases if aliases.count(alias) > 1}) == []


def compared(node: ast.Compare) -> set[str]:
    """The texts that a comparison names."""
    sides = [node.left, *node.comparators]
    return {
        part.value
        for side in sides
        for part in (side.elts if isinstance(side, ast.Tuple | ast.List | ast.Set) else [side])
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    }


@pytest.mark.parametrize(
    ("names", "homes"),
    [
        (shipped(), ("controller/",)),
        (SCHEMES, ("plant/schemes/",)),
        (STRUCTURES, ("plant/structures/",)),
    ],
    ids=["law", "scheme", "structure"],
)
def test_no_name_of_a_plug_in_is_compared(names, homes):
    found = [
        f"{path}:{node.lineno}: {ast.unparse(node)}"
        for path, tree in PRODUCT.items()
        if not path.startswith(homes)
        for node in ast.walk(tree)
        if isinstance(node, ast.Compare) and compared(node) & set(names)
    ]
    assert not found, "\n".join(found)
