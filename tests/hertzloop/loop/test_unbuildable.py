"""A scene whose controller cannot be built."""

from tests.commands import as_options, refused


def test_a_force_that_cannot_be_known_leaves_no_file(tmp_path):
    """The contact without control does not end; only building the controller shows it."""
    keys = ["controller.law=precomputed", "sphere.radius_m=0.2", "run.accuracy=0.3"]
    sets = as_options(keys)
    words = ["--transport", "inprocess", "--out", str(tmp_path / "a.mcap")]
    refused("does not end", "run", "sylomer-20mm", *sets, *words)
    assert not (tmp_path / "a.mcap").exists()
