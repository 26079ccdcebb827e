"""Searches and charts cut short: they go on where they were, and find what they would have."""

import errno
import os
from collections.abc import Iterator
from typing import Any

import pytest

from hertzloop.results.spans import Span
from hertzloop.scene.setup import load
from hertzloop.studies.cases.evaluate import Numbered, Pool, evaluate
from hertzloop.studies.cases.journal import Journal, kept
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.cases.rows import Rows
from tests.commands import invoke
from tests.studies.sweeping import COARSE

SHORT = ["aluminium-3mm", "--set", "run.accuracy=0.05", "--set", "run.duration_s=0.0013"]


@pytest.mark.full
@pytest.mark.parametrize(
    "words",
    [
        [
            "sweep",
            *SHORT,
            "--over",
            "controller.latency_us=0:60:1",
            "--workers",
            "1",
            "-o",
            "r.csv",
        ],
        [
            "tune",
            *SHORT,
            "--law",
            "predicted",
            "--generations",
            "2",
            "--population",
            "20",
            "-o",
            ".",
        ],
    ],
)
def test_a_full_disk_ends_a_study_in_a_sentence_and_keeps_what_is_done(
    tmp_path, monkeypatch, words
):
    """Its journal, that is, whose last line is torn."""
    monkeypatch.chdir(tmp_path)
    write, left = Journal._write, [6]

    def full(self: Journal, row: dict[str, Any]) -> None:
        left[0] -= 1
        if left[0]:
            return write(self, row)
        self._file.write(b'{"case": 1, "torn')
        self._file.flush()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(Journal, "_write", full)
        result = invoke(words)
    assert result.exit_code == 1
    said = " ".join(result.stderr.split())
    assert "No space left on device; finished cases are kept" in said
    path = next(tmp_path.glob("*.partial"))
    assert len(path.read_bytes().splitlines()) == 6
    result = invoke(words)
    assert result.exit_code == 0, result.stderr
    assert words[0] == "sweep" or "Continuing with 4 finished cases" in result.stderr
    assert not path.exists()
    (results,) = tmp_path.glob("*.csv")
    continued = results.read_bytes()
    for made in tmp_path.iterdir():
        made.unlink()
    assert invoke(words).exit_code == 0
    assert results.read_bytes() == continued


def _counted(pool: Pool, ran: list[str]) -> Pool:
    """The same pool, which notes what it runs."""

    def results(toml: str, span: Span, chunks: list[Numbered]) -> Iterator[Rows]:
        for chunk in chunks:
            for rows in pool(toml, span, [chunk]):
                ran.extend(repr((toml, span, values)) for _, values in chunk)
                yield rows

    return results


def test_a_case_asked_for_twice_is_run_once(tmp_path):
    scene, ran = load("aluminium-3mm", COARSE), list[str]()
    cases = [{"controller.latency_us": latency} for latency in (1, 2, 1)]
    with local_pool(1) as pool:
        plain = evaluate(pool, scene, "impact", cases)
        with kept(tmp_path, "a", {}) as finished:
            some = finished.skipping_finished(_counted(pool, ran))
            found = [evaluate(some, scene, "impact", cases) for _ in range(2)]
    assert found == [plain, plain]
    assert len(ran) == finished.ran == 2


def test_other_work_has_another_file(tmp_path):
    with kept(tmp_path, "a", {"seed": 1}) as one, kept(tmp_path, "a", {"seed": 2}) as other:
        assert one.journal.path != other.journal.path
