"""A few attacks on the bus of a run; a long series: see `tests.faults.attacks`."""

import tempfile
from pathlib import Path

import pytest

from hertzloop.bus.streams import CONTROLLER, PLANT
from tests.faults.attacks import OBSERVER, STRANGER, Attack, attacked

ATTACKS = [
    Attack(CONTROLLER, "lost", "force", 3),
    Attack(CONTROLLER, "messages", "end/controller"),
    Attack(PLANT, "repeated", "truth", 2, shared_memory=False),
    Attack(STRANGER, "the next message", "daq", after_s=0.5),
    Attack(STRANGER, OBSERVER, "daq"),
]


@pytest.mark.full
@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize("attack", ATTACKS, ids=str)
def test_attacks(attack):
    with tempfile.TemporaryDirectory() as folder:
        outcome = attacked(attack, Path(folder))
    assert outcome.wrong == [], outcome
