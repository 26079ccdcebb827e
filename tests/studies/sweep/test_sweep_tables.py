"""Tables of a sweep on the screen."""

from tests.commands import call, said

SHORT = ["--set", "run.accuracy=0.05", "--set", "run.duration_s=0.002"]


def test_a_sweep_of_one_key_prints_each_case_and_of_many_every_so_many(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def told(latencies: str) -> tuple[list[str], str]:
        words = ["sweep", "aluminium-3mm", *SHORT, "--workers", "1", "--overwrite", "--over"]
        done = call(*words, f"controller.latency_us={latencies}")
        assert done.exit_code == 0, done.output
        lines = [line for line in done.output.splitlines() if "│" in line]
        return [line.split("│")[1].strip() for line in lines], said(done)

    assert told("0:2:1")[0][:3] in (["0.0", "1.0", "2.0"], ["0", "1", "2"])
    rows, words = told("0:29:1")
    assert rows[1] in ("2.0", "2")
    assert "15 of 30; the file of results has all" in words
