"""Every scheme runs from the command line, from the warm-up on."""

from pathlib import Path

import pytest

from hertzloop.plant.schemes.registry import SCHEMES
from tests.commands import as_options, refused, succeed
from tests.tiers import default

SCENE = {"thesis2008": "thesis-aluminium"}


@pytest.mark.parametrize("scheme", default(SCHEMES, ["modal", "thesis2008"]))
def test_every_scheme_runs(scheme: str, tmp_path: Path) -> None:
    words = ["--transport", "compiled", "--set", f"run.scheme={scheme}"]
    words += ["--set", "run.duration_s=0.0012", "--out", str(tmp_path / "a.mcap")]
    succeed("run", SCENE.get(scheme, "aluminium-3mm"), *words)
    assert (tmp_path / "a.mcap").is_file()


@pytest.mark.full
@pytest.mark.parametrize(
    ("scene", "settings", "words"),
    [
        ("aluminium-3mm", ["plate.contact_point_m=[0.25, 1e-10]"], "plate.contact_point_m"),
        ("aluminium-3mm", ["plate.thickness_m=1.0", "plate.size_m=[0.01, 0.01]",
                           "plate.contact_point_m=[0.005, 0.005]"], "lowest mode"),
        ("thesis-aluminium", ["contact.viscous_n_s_m=1e9"], "contact.viscous_n_s_m"),
    ],
)  # fmt: skip
def test_what_cannot_be_run_leaves_no_file(
    scene: str, settings: list[str], words: str, tmp_path: Path
) -> None:
    file = tmp_path / "a.mcap"
    sets = as_options(settings)
    refused(words, "run", scene, *sets, "--out", str(file))
    assert not file.exists()


def test_a_force_that_cannot_be_known_leaves_no_file(tmp_path: Path) -> None:
    """The contact without control does not end; only building the controller shows it."""
    keys = ["controller.law=precomputed", "sphere.radius_m=0.2", "run.accuracy=0.3"]
    sets = as_options(keys)
    words = ["--transport", "inprocess", "--out", str(tmp_path / "a.mcap")]
    refused("does not end", "run", "sylomer-20mm", *sets, *words)
    assert not (tmp_path / "a.mcap").exists()
