"""The command that puts deliberate faults into the sources, on a small package of its own."""

import psutil
import pytest

pytest.importorskip("cosmic_ray", reason="mutants need the extra: pip install -e '.[mutants]'")

from tests.mutants.__main__ import Row, mutation_of, run, table
from tests.mutants.listing import Mutation, mutated, mutations, sources
from tests.mutants.trying import Busy, copy_of

pytestmark = pytest.mark.full

CODE = '''"""Sums."""
from typing import overload
kernel = staticmethod
def doubled(x: int | None = 2) -> int | str:
    return x * 2

@kernel
def compiled(x):
    return x + 1

def unheard_of(x):
    return x + 7

@overload
def typed(x: int): ...
'''
TESTS = """import subprocess, sys

def test_in_a_child(tmp_path):
    words = [sys.executable, "-c", "import toy.sums; print(toy.sums.doubled(4))"]
    assert subprocess.run(words, cwd=tmp_path, capture_output=True).stdout == b"8\\n"
"""
LEAVES_A_CHILD = """import subprocess, sys
from pathlib import Path

def test_fails_meanwhile():
    words = [sys.executable, "-c", "import time; print(1, flush=True); time.sleep(600)"]
    child = subprocess.Popen(words, start_new_session=True, stdout=subprocess.PIPE)
    child.stdout.readline()
    Path({path!r}).write_text(str(child.pid))
    assert False
"""


@pytest.fixture
def toy(tmp_path):
    """Root of sources: a package, and its tests."""
    root = tmp_path / "root"
    for name, text in {
        "toy/__init__.py": "",
        "toy/sums.py": CODE,
        "toy/loop_kernels.py": "x = 1 + 2\n",
        "toy/some_pb2.py": "x = 1 + 2\n",
        "toy/far.py": "import toy.sums\n",
        "tests/toy/test_sums.py": "import toy.sums\n" + TESTS,
        "tests/toy/test_other.py": "def test_nothing(): pass\n",
        "tests/above/test_far.py": "import toy.far\n\ndef test_nothing(): pass\n",
        "tests/above/test_broken.py": "import toy.far\n\ndef test_it(): assert False\n",
        "tests/test_checks.py": "def test_form(): assert False\n",
    }.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def test_only_what_changes_a_program_is_listed(toy):
    assert sources(toy, "toy") == ["toy/__init__.py", "toy/far.py", "toy/sums.py"]
    found = mutations(toy, "toy/sums.py")
    assert {one.line for one in found} == {4, 5, 12}
    assert {one.operator for one in found if one.line == 4} == {"NumberReplacer"}
    assert mutated("x = 1\n", Mutation("", 1, "NumberReplacer", 0)) == "x = 2\n"
    assert mutated("def f(*, a): 1", Mutation("", 1, "ReplaceBinaryOperator_Mul_Add", 0)) is None


def test_a_mutant_is_killed_in_a_child_of_a_test_and_another_survives(toy, tmp_path, capsys):
    found = mutations(toy, "toy/sums.py")
    noticed = next(one for one in found if one.operator == "ReplaceBinaryOperator_Mul_Add")
    missed = next(one for one in found if one.operator == "ReplaceBinaryOperator_Add_Sub")
    rows: list[Row] = []
    results = tmp_path / "results.jsonl"
    with copy_of(toy, 100.0, folder=tmp_path / "copy") as copy:
        run(copy, [noticed, missed], rows, results)
        assert (copy.tree / "toy/sums.py").read_text() == CODE
        with pytest.raises(Busy), copy_of(toy, 100.0, folder=tmp_path / "copy"):
            pass
    assert [row["outcome"] for row in rows] == ["killed", "survived"]
    assert [mutation_of(row) for row in rows] == [noticed, missed]
    assert rows[1]["tests"] == [
        "tests/toy/test_sums.py",
        "tests/above/test_far.py",
        "tests/toy/test_other.py",
    ]
    assert len(results.read_text().splitlines()) == 2
    assert (toy / "toy/sums.py").read_text() == CODE
    said = capsys.readouterr().out
    assert "tests/above/test_broken.py is left out: killed without any mutant" in said
    assert "-    return x + 7\n+    return x - 7" in said
    assert table(rows).splitlines()[2] == "| toy | 2 | 1 | 0 | 1 | 0 | 50.0% |"


def test_what_a_test_leaves_behind_is_ended(toy, tmp_path):
    pid = tmp_path / "pid"
    (toy / "tests/toy/test_sums.py").write_text(LEAVES_A_CHILD.format(path=str(pid)))
    with copy_of(toy, 100.0, folder=tmp_path / "copy") as copy:
        assert copy.run(["tests/toy/test_sums.py"])[0] == "killed"
        assert copy.run(["tests/toy/test_sums.py"], 0.0)[0] == "timed out"
    number = int(pid.read_text())
    assert not psutil.pid_exists(number) or psutil.Process(number).status() == "zombie"
