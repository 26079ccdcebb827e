"""The plant as a co-simulation unit: valid, the bytes of the compiled loop, clear about bad use."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.interop.fmu import write_fmu
from hertzloop.interop.image import image
from hertzloop.interop.objects import HOST
from hertzloop.loop.simulate import simulate
from tests.commands import as_options, refused, succeed
from tests.hertzloop.interop.plant_in_c import NOISY, SHORT
from tests.hertzloop.own_laws import needs_cc
from tests.hertzloop.scenes import aluminium_3mm

fmpy = pytest.importorskip("fmpy")

from fmpy.simulation import instantiate_fmu  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = [needs_cc, pytest.mark.full]
STEP_S = 1e-6


@pytest.fixture(scope="module", params=["2", "3"])
def path(request, tmp_path_factory):
    out = tmp_path_factory.mktemp("fmu") / "plant.fmu"
    write_fmu(image(aluminium_3mm(*NOISY)), HOST, request.param, out)
    return out


@pytest.fixture(scope="module")
def loop():
    return simulate(aluminium_3mm(*NOISY))


class Master:
    """One instance of a unit under FMPy, of either version."""

    def __init__(self, path: Path, token: str | None = None, log: list[str] | None = None) -> None:
        self.about = fmpy.read_model_description(str(path))
        self.two = self.about.fmiVersion == "2.0"
        self.references = {v.name: v.valueReference for v in self.about.modelVariables}
        self.log: list[str] = [] if log is None else log
        self.about.guid = token or self.about.guid
        folder = path.with_suffix("")
        if not folder.exists():  # a library that is loaded must stay as it is
            fmpy.extract(str(path), str(folder))
        self.unit: Any = instantiate_fmu(
            str(folder), self.about, logger=lambda *words: self.log.append(words[-1].decode())
        )

    def start(self, **parameters: float) -> "Master":
        """Set parameters, and begin to step."""
        for name, value in parameters.items():
            self.set(name, value)
        if self.two:
            self.unit.setupExperiment(startTime=0.0)
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()
        return self

    def set(self, name: str, value: float) -> None:
        whole = isinstance(value, int)
        named = ("setInteger", "setReal") if self.two else ("setInt64", "setFloat64")
        getattr(self.unit, named[0] if whole else named[1])([self.references[name]], [value])

    def get(self, *names: str) -> list[float]:
        get = self.unit.getReal if self.two else self.unit.getFloat64
        return list(get([self.references[name] for name in names]))

    def step(self, now_s: float, step_s: float = STEP_S) -> None:
        self.unit.doStep(now_s, step_s)

    def run(self, forces: np.ndarray, first: int, *names: str) -> np.ndarray:
        """Outputs after steps of one force each, shape (steps, names)."""
        seen = np.zeros((len(forces), len(names)))
        for i, force in enumerate(forces):
            self.set("force_command", float(force))
            self.step((first + i) * STEP_S)
            seen[i] = self.get(*names)
        return seen


@pytest.fixture
def master(path):
    master = Master(path)
    yield master
    master.unit.freeInstance()


def test_it_is_valid_and_describes_its_variables(path):
    assert validate_fmu(str(path)) == []
    about = fmpy.read_model_description(str(path))
    assert about.coSimulation.canGetAndSetFMUstate
    assert about.coSimulation.canSerializeFMUstate
    for variable in about.modelVariables:
        assert variable.description
        assert variable.unit or variable.name.startswith(("noise", "sample_", "energy_"))
    assert about.defaultExperiment.stopTime == "0.002"


def test_its_outputs_are_the_bytes_of_the_loop(master, loop):
    master.start()
    assert master.get("sample", "gap") == [loop.values[0], loop.truth[0, 0]]
    names = "gap", "plate_velocity", "contact_force", "actuator_force", "sample"
    gap, velocity, contact, actuator, sample = master.run(loop.forces, 0, *names).T.copy()
    assert gap[:-1].tobytes() == loop.truth[0, 1:].tobytes()
    assert velocity[:-1].tobytes() == loop.truth[3, 1:].tobytes()
    assert contact.tobytes() == loop.truth[4].tobytes()
    assert actuator.tobytes() == loop.truth[5].tobytes()
    assert sample[1:-1:2].tobytes() == loop.values[1:].tobytes()
    energies = master.get("kinetic_energy", "modal_energy", "injected_energy")
    assert energies == [loop.balance.kinetic_j, loop.balance.modal_j, loop.balance.injected_j]


def test_longer_communication_steps_hold_the_force(master, path):
    """Ten steps at once are ten steps with one force."""
    other = Master(path).start()
    master.start()
    one = master.run(np.repeat([0.0, 3.0, 1.0] * 40, 10), 0, "gap", "contact_force")
    for i, force in enumerate([0.0, 3.0, 1.0] * 40):
        other.set("force_command", force)
        other.step(10 * i * STEP_S, 10 * STEP_S)
    assert other.get("gap", "contact_force") == list(one[-1])
    other.unit.freeInstance()


def test_a_master_may_repeat_steps(master, path):
    forces, outputs = np.linspace(0.0, 9.0, 500), ("gap", "sample")
    unit = master.start().unit
    master.run(np.full(300, 0.5), 0, "gap")
    state = unit.getFMUState()
    once = master.run(forces, 300, *outputs)
    unit.setFMUState(state)
    assert master.get("force_command") == [0.5]
    assert master.run(forces, 300, *outputs).tobytes() == once.tobytes()
    other = Master(path).start()
    opened = other.unit.deserializeFMUState(unit.serializeFMUState(state))
    other.unit.setFMUState(opened)
    assert other.run(forces, 300, *outputs).tobytes() == once.tobytes()
    other.unit.freeFMUState(opened)
    unit.freeFMUState(state)
    other.unit.freeInstance()
    with pytest.raises(Exception, match="error"):
        unit.deserializeFMUState(b"too short")
    # FMPy gives the messages of all units of FMI 2 to the last one.
    assert re.fullmatch(r"a state has \d+ bytes, not 9", (master.log + other.log)[-1])


def test_it_starts_anew_with_other_parameters(master):
    first = master.start().get("gap")
    master.run(np.zeros(200), 0, "gap")
    master.unit.reset()
    assert master.get("gap") == first
    master.unit.reset()
    for name, value in (("drop_height", 0.0), ("noise_seed", -1)):
        with pytest.raises(Exception, match="error"):
            master.set(name, value)
    assert master.log == [
        "drop_height is 0 m; 1e-7 to 100 is possible",
        "noise_seed is -1; it is 0 or more",
    ]
    seed = simulate(aluminium_3mm(*NOISY, "run.seed=9"))
    assert master.start(noise_seed=9).get("gap", "sample") == [seed.truth[0, 0], seed.values[0]]


_BAD: list[tuple[Callable[[Master], Any], str, str]] = [
    (lambda m: m.step(0.0003, 1.5e-6), "discard",
     "a communication step of 1.5e-06 s is asked for; it has to be a multiple of 1e-06 s"),
    (lambda m: m.step(0.0001), "error",
     "a step from 0.0001 s is asked for; the unit is at 0.0003 s"),
    (lambda m: m.set("gap", 1.0), "error",
     "the real variable 7 cannot be set; force_command and drop_height can"),
    (lambda m: m.unit.enterInitializationMode(), "error",
     r"fmi\dEnterInitializationMode while the unit is stepping; it has to be instantiated"),
]  # fmt: skip


@pytest.mark.parametrize(("use", "status", "sentence"), _BAD)
def test_bad_use_is_a_status_and_a_message(master, use, status, sentence):
    master.start().run(np.full(300, 0.5), 0, "gap")
    before = master.get("time", "gap", "force_command", "drop_height")
    with pytest.raises(Exception, match=status):
        use(master)
    assert re.fullmatch(sentence, master.log[-1]), master.log
    assert master.get("time", "gap", "force_command", "drop_height") == before
    master.run(np.zeros(3), 300, "gap")  # and it goes on


def test_the_command_writes_a_unit(tmp_path):
    out = tmp_path / "plant.fmu"
    words = ["export-plant", "aluminium-3mm", *as_options(SHORT), "-o", out, "--cpu", "host"]
    succeed(*words)
    assert fmpy.read_model_description(str(out)).fmiVersion == "3.0"
    older = [*words, "--overwrite", "--fmi", "2", "--set", "run.seed=5000000000"]
    refused("run.seed = 5000000000 is too large for FMI 2.0", *older)
