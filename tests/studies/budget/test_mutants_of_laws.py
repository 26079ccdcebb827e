"""Requirements detect seeded faults in laws, and pass equivalent rewrites of them."""

import ast
import random
from pathlib import Path

import pytest

from hertzloop.controller import laws
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.studies.budget.requirements.check import check, digits_of
from hertzloop.studies.budget.requirements.requirement import read_requirements
from hertzloop.studies.cases.evaluate import evaluate

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
    {},
    {"controller.latency_us": 2},
    {"run.touch_phase": 0.1},
    {"sensors.bits": 10},
)
BASE = {"run.duration_s": 0.0016}
GAIN = {"controller.kappa": 0.4}  # at which all of them are stable
MUTANTS, REWRITES = 30, 20


def source(law):
    """Text of a shipped law."""
    return (Path(laws.__file__).parent / f"{law}.py").read_text()


def _returned(text):
    """Put another expression, of x, in the place of what a function returns."""

    def change(node):
        if not isinstance(node, ast.Return):
            return None
        return ast.parse(text.replace("x", f"({ast.unparse(node.value)})")).body[0]

    return change


def _off_by_one(node):
    if isinstance(node, ast.Subscript) and ast.unparse(node) == "samples[i]":
        return ast.parse("samples[max(i - 1, 0)]", mode="eval").body
    return None


def _compared(operators, turned):
    """Other operators in a comparison, with its sides exchanged if it is turned."""

    def change(node):
        if not isinstance(node, ast.Compare) or (turned and type(node.ops[0]) not in operators):
            return None
        left, [right] = node.left, node.comparators
        ops = [operators.get(type(op), type(op))() for op in node.ops]
        return ast.Compare(right, ops, [left]) if turned else ast.Compare(left, ops, [right])

    return change


def _commuted(node):
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mult):
        return ast.BinOp(node.right, node.op, node.left)
    return None


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


MUTATIONS = {
    "sign": _returned("return -x"),
    "gain 1.1": _returned("return 1.1 * x"),
    "gain 0.9": _returned("return 0.9 * x"),
    "gain 1.01": _returned("return 1.01 * x"),
    "off by one": _off_by_one,
    "threshold": _compared(
        {ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.NotEq: ast.Eq, ast.Eq: ast.NotEq}, turned=False
    ),
}
EQUIVALENT = {
    "commuted": _commuted,
    "turned": _compared(
        {ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.NotEq: ast.NotEq, ast.Eq: ast.Eq}, turned=True
    ),
    "halved twice": _returned("return (x + x) * 0.5"),  # which is exact
    "negated twice": _returned("return --x"),
}


def drawn(kinds, count, seed):
    """So many changes of shipped laws, drawn by a seed: law, name of the kind, text."""
    every = [
        (law, f"{name} {site}", text)
        for law in LAWS
        for name, kind in kinds.items()
        for site in range(8)
        if (text := changed(law, kind, site)) is not None
    ]
    random.Random(seed).shuffle(every)
    return every[:count]


def written(folder, number, text):
    """A folder with the text as its law."""
    place = folder / str(number)
    place.mkdir()
    (place / "law.py").write_text(text)
    return place


@pytest.fixture(scope="module")
def truths(pool):
    """Metrics of the shipped laws in all cases."""
    return {
        law: evaluate(
            pool,
            load("aluminium-3mm", [f"controller.law={law}"]).vary(BASE | GAIN),
            "impact",
            [dict(case) for case in CASES],
        )
        for law in LAWS
    }


def requirements_of(truth, folder):
    """Requirements that ask for the metrics of a law, for law.py in the same folder."""
    lines = ["[hertzloop]", 'law = "law.py"']
    for number, (case, row) in enumerate(zip(CASES, truth, strict=True)):
        given = ", ".join(f'"{key}" = {value}' for key, value in (BASE | GAIN | case).items())
        wanted = ", ".join(f"{metric} = {row[metric]!r}" for metric in METRICS)
        lines += [
            "[[requirement]]",
            f'name = "case {number}"',
            'scene = "aluminium-3mm"',
            f"set = {{ {given} }}",
            f"expect = {{ {wanted} }}",
        ]
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
    changing = 0
    for number, (law, kind, text) in enumerate(drawn(MUTATIONS, MUTANTS, 42)):
        folder = written(tmp_path, number, text)
        wrong = differs(pool, folder, truths[law])
        changing += wrong
        assert caught(pool, requirements_of(truths[law], folder)) == wrong, (law, kind)
    print(f"{MUTANTS} mutants, {changing} change a metric by more than its digits")
    assert changing >= MUTANTS / 2


@pytest.mark.full
def test_equivalent_rewrites_pass(pool, truths, tmp_path):
    for number, (law, kind, text) in enumerate(drawn(EQUIVALENT, REWRITES, 7)):
        folder = written(tmp_path, number, text)
        assert not caught(pool, requirements_of(truths[law], folder)), (law, kind)
