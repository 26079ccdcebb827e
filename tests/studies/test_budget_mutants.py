"""Requirements detect seeded faults in laws, and pass equivalent rewrites of them."""

import ast
import copy
import random
from pathlib import Path

import pytest

from hertzloop.controller import laws
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.studies.budget.requirements import check, digits_of, read_requirements
from hertzloop.studies.sweeps.evaluate import evaluate
from hertzloop.studies.sweeps.pool import local_pool

LAWS = (
    "force_feedback",
    "velocity_feedback",
    "acceleration_feedback",
    "slope_threshold",
    "fade_out",
    "least_squares",
)
METRICS = ("plate_energy_db", "rebound_percent", "peak_force_n", "radiated_db", "contact_us")
CASES: tuple[dict[str, object], ...] = (
    {}, {"controller.latency_us": 2}, {"run.touch_phase": 0.1}, {"sensors.bits": 10},
)  # fmt: skip
BASE = {"run.duration_s": 0.0016}
GAIN = {"controller.kappa": 0.4}  # at which all of them are stable
MUTANTS, REWRITES = 30, 20


def source(law):
    """Text of a shipped law."""
    return (Path(laws.__file__).parent / f"{law}.py").read_text()


def _sign(node):
    return ast.Return(ast.UnaryOp(ast.USub(), node.value)) if isinstance(node, ast.Return) else None


def _scaled(factor):
    def gain(node):
        if not isinstance(node, ast.Return):
            return None
        return ast.Return(ast.BinOp(ast.Constant(factor), ast.Mult(), node.value))

    return gain


def _off_by_one(node):
    if isinstance(node, ast.Subscript) and ast.unparse(node) == "samples[i]":
        return ast.parse("samples[max(i - 1, 0)]", mode="eval").body
    return None


def _threshold(node):
    swapped = {ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.NotEq: ast.Eq, ast.Eq: ast.NotEq}
    if not isinstance(node, ast.Compare):
        return None
    changed = copy.deepcopy(node)
    changed.ops = [swapped.get(type(op), type(op))() for op in node.ops]
    return changed


def _commuted(node):
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mult):
        return ast.BinOp(node.right, node.op, node.left)
    return None


def _turned(node):
    turned = {ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.NotEq: ast.NotEq, ast.Eq: ast.Eq}
    if not isinstance(node, ast.Compare) or type(node.ops[0]) not in turned:
        return None
    return ast.Compare(node.comparators[0], [turned[type(node.ops[0])]()], [node.left])


def _halved_twice(node):
    """x becomes (x + x) / 2, which is exact."""
    if not isinstance(node, ast.Return):
        return None
    double = ast.BinOp(copy.deepcopy(node.value), ast.Add(), node.value)
    return ast.Return(ast.BinOp(double, ast.Mult(), ast.Constant(0.5)))


def _negated_twice(node):
    if not isinstance(node, ast.Return):
        return None
    return ast.Return(ast.UnaryOp(ast.USub(), ast.UnaryOp(ast.USub(), node.value)))


class _Change(ast.NodeTransformer):
    """Changes site number `wanted` of one kind within `command`."""

    def __init__(self, kind, wanted):
        self.kind, self.wanted, self.seen = kind, wanted, -1

    def visit(self, node):
        changed = self.kind(node)
        if changed is not None:
            self.seen += 1
            if self.seen == self.wanted:
                return changed
        return self.generic_visit(node)


def changed(law, kind, site):
    """Text of a law with one change; None if it has fewer sites."""
    tree = ast.parse(source(law))
    change = _Change(kind, site)
    for i, part in enumerate(tree.body):
        if isinstance(part, ast.FunctionDef) and part.name == "command":
            tree.body[i] = change.visit(part)
    if change.seen < site:
        return None
    return ast.unparse(ast.fix_missing_locations(tree))


MUTATIONS = (_sign, _scaled(1.1), _scaled(0.9), _scaled(1.01), _off_by_one, _threshold)


def drawn(kinds, count, seed):
    """So many changes of shipped laws, drawn by a seed: law, name of the kind, text."""
    every = [
        (law, f"{kind.__name__}{site}", text)
        for law in LAWS for kind in kinds for site in range(8)
        if (text := changed(law, kind, site)) is not None
    ]  # fmt: skip
    order = random.Random(seed)
    order.shuffle(every)
    return every[:count]


@pytest.fixture(scope="module")
def pool():
    with local_pool(1) as found:
        yield found


@pytest.fixture(scope="module")
def truths(pool):
    """Metrics of the shipped laws in all cases."""
    return {
        law: evaluate(pool, load("aluminium-3mm", [f"controller.law={law}"]).vary(BASE | GAIN),
                      "impact", [dict(case) for case in CASES])
        for law in LAWS
    }  # fmt: skip


def requirements_of(truth, folder):
    """Requirements that ask for the metrics of a law, for law.py in the same folder."""
    lines = ["[hertzloop]", 'law = "law.py"']
    for number, (case, row) in enumerate(zip(CASES, truth, strict=True)):
        given = ", ".join(f'"{key}" = {value}' for key, value in (BASE | GAIN | case).items())
        wanted = ", ".join(f"{metric} = {row[metric]!r}" for metric in METRICS)
        lines += ["[[requirement]]", f'name = "case {number}"', 'scene = "aluminium-3mm"',
                  f"set = {{ {given} }}", f"expect = {{ {wanted} }}"]  # fmt: skip
    (folder / "requirements.toml").write_text("\n".join(lines))
    return read_requirements(folder / "requirements.toml")


def caught(pool, rows):
    """Whether a row fails, or cannot be run."""
    try:
        return any(not check(pool, row).passed for row in rows)
    except SceneError:
        return True


def differs(pool, folder, truth):
    """Whether a metric of law.py differs by more than its digits, which is worked out apart from
    the requirements."""
    try:
        setup = load("aluminium-3mm", [f"controller.law={folder / 'law.py'}"]).vary(BASE | GAIN)
        rows = evaluate(pool, setup, "impact", [dict(case) for case in CASES])
    except SceneError:
        return True
    for row, right in zip(rows, truth, strict=True):
        for metric in METRICS:
            if row["status"] or abs(row[metric] - right[metric]) > digits_of(
                setup, metric, right[metric]
            ):
                return True
    return False


@pytest.mark.full
def test_mutants_are_caught(pool, truths, tmp_path):
    mutants = drawn(MUTATIONS, MUTANTS, 42)
    changing = 0
    for number, (law, kind, text) in enumerate(mutants):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "law.py").write_text(text)
        wrong = differs(pool, folder, truths[law])
        changing += wrong
        print(number, law, kind, "differs" if wrong else "the same", flush=True)
        assert caught(pool, requirements_of(truths[law], folder)) == wrong, (law, kind)
    print(f"{len(mutants)} mutants, {changing} change a metric by more than its digits")
    assert changing >= len(mutants) / 2


@pytest.mark.full
def test_equivalent_rewrites_pass(pool, truths, tmp_path):
    rewrites = drawn((_commuted, _turned, _halved_twice, _negated_twice), REWRITES, 7)
    for number, (law, kind, text) in enumerate(rewrites):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "law.py").write_text(text)
        print(number, law, kind, flush=True)
        assert not caught(pool, requirements_of(truths[law], folder)), (law, kind)
    print(f"{len(rewrites)} rewrites pass")
