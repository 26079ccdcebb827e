"""A short series of damages; long ones, with other seeds: see `tests.recordings.damages`."""

from pathlib import Path

from recordings.reader import read
from recordings.recovery import recover
from tests.recordings.damages import DAMAGES, chunks, many_chunks, try_many, undamaged

TRIES, SEED = 45, 20


def test_damages(tmp_path: Path) -> None:
    source = many_chunks(tmp_path)
    tally = try_many(source, tmp_path, TRIES, SEED)
    assert tally.wrong == [], f"python -m tests.recordings.damages --tries {TRIES} --seed {SEED}"
    assert set(tally.tries) == {damage.__name__ for damage in DAMAGES}
    # Which chunks a copy loses is for the long series: here, that it is rare.
    assert sum(tally.recovered_chunks.values()) > 0.8 * sum(tally.whole_chunks.values()) > TRIES


def test_chunks_behind_the_end_of_the_data_are_recovered(tmp_path: Path) -> None:
    """Parts of the file have changed places: its end came before some of its chunks."""
    source = many_chunks(tmp_path)
    content = source.read_bytes()
    parts = chunks(content)
    first, last = (content.find(parts[n][0]) for n in (len(parts) // 2, len(parts) - 1))
    moved = content[:first] + content[last:] + content[first:last]
    assert len(undamaged(moved, parts[:-1])) == len(parts) - 1
    source.write_bytes(moved)
    assert read(source).problems
    recover(source, tmp_path / "again.mcap")
    have = {one for _, inside in chunks((tmp_path / "again.mcap").read_bytes()) for one in inside}
    assert [n for n, (_, payloads) in enumerate(parts) if not have.issuperset(payloads)] == []
