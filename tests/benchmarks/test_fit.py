"""The benchmarks of `fit`: theory that they compare with, and one problem of each kind."""

import pytest

from benchmarks import fit_validation
from benchmarks.zener import solved


@pytest.mark.parametrize(
    ("inelasticity", "restitution"),
    [
        (0.05, 0.9178),
        (0.5, 0.4369),
        (1.5, 0.0664),
    ],
)
def test_zeners_equation_gives_the_published_restitution(inelasticity, restitution):
    assert solved(inelasticity)[2] == pytest.approx(restitution, abs=5e-5)


def test_the_infinite_plate_follows_zener():
    """Up to gravity, which takes about g T of the speed."""
    simulated = fit_validation.restitution_on_infinite_plate(0.25)
    assert simulated == pytest.approx(solved(0.25)[2], abs=3e-4)
