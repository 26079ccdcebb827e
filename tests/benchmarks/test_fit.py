"""The benchmarks of `fit`: theory that they compare with."""

import pytest

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
