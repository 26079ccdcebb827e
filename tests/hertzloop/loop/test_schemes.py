"""Every scheme runs from the command line, from the warm-up on."""

import pytest

from hertzloop.plant.schemes.registry import SCHEMES
from tests.commands import as_options, refused, succeed
from tests.tiers import default

SCENE = {"thesis2008": "thesis-aluminium"}


@pytest.mark.parametrize("scheme", default(SCHEMES, ["modal", "thesis2008"]))
def test_every_scheme_runs(scheme, tmp_path):
    words = ["--transport", "compiled", "--set", f"run.scheme={scheme}"]
    words += ["--set", "run.duration_s=0.0012", "--out", str(tmp_path / "a.mcap")]
    succeed("run", SCENE.get(scheme, "aluminium-3mm"), *words)
    assert (tmp_path / "a.mcap").is_file()


def test_a_force_that_cannot_be_known_leaves_no_file(tmp_path):
    """The contact without control does not end; only building the controller shows it."""
    keys = ["controller.law=precomputed", "sphere.radius_m=0.2", "run.accuracy=0.3"]
    sets = as_options(keys)
    words = ["--transport", "inprocess", "--out", str(tmp_path / "a.mcap")]
    refused("does not end", "run", "sylomer-20mm", *sets, *words)
    assert not (tmp_path / "a.mcap").exists()
