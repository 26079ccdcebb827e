"""A law that is a co-simulation unit (FMU), as other tools export them."""

import zipfile
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from hertzloop.controller.controller import Controller, SignalPath
from hertzloop.loop.answering import answer_samples
from hertzloop.loop.run_options import Transport
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.recording import Recording
from hertzloop.scene.controller import bound_law, loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from tests.commands import as_options, refused
from tests.hertzloop.commands import python
from tests.hertzloop.scenes import aluminium_3mm, run_recorded

pytest.importorskip("fmpy")
pytest.importorskip("pythonfmu")

pytestmark = pytest.mark.full

SHORT = "run.duration_s=0.0013"
# {fault}: comes before a step is over.
UNIT = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class SpringLaw(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.{name} = self.force = self.kept = 0.0
        self.gain = 1e6
        parameter = {{"causality": Fmi2Causality.parameter,
                     "variability": Fmi2Variability.tunable}}
        self.register_variable(Real("{name}", causality=Fmi2Causality.input))
        self.register_variable(Real("gain", description="force by depth", **parameter))
        {more}
        self.register_variable(Real("force", causality=Fmi2Causality.output))

    def setup_experiment(self, start_time, *_):
        assert start_time == 0.0

    def do_step(self, t, h):
        self.kept = 0.5 * self.kept + 0.5 * max(-self.{name}, 0.0)
        self.force = self.gain * self.kept
        {fault}
        return True
"""
TWIN = """
from hertzloop.law import ACTING, WATCHING, Keys

class Parameters(Keys):
    gain: float = 1e6

class State:
    kept: float = 0.0

def command(p, s, samples, i):
    s.kept = 0.5 * s.kept + 0.5 * max(-samples[i], 0.0)
    s.mode = ACTING if s.kept != 0.0 else WATCHING
    return p.gain * s.kept
"""


_NUMBERS = count()


def built(folder: Path, fault: str = "pass", more: str = "pass", name: str = "xi") -> Path:
    """The unit, made by PythonFMU; `name`: of its input. Units of one process share Python's
    modules, so each has its own."""
    source = f"spring_{next(_NUMBERS)}.py"
    (folder / source).write_text(UNIT.format(fault=fault, more=more, name=name))
    python("-m", "pythonfmu", "build", "-f", source, "-d", ".", cwd=folder)
    return folder / "SpringLaw.fmu"


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    return built(tmp_path_factory.mktemp("unit"))


def scene_of(law: Path, *more: str) -> Setup:
    return aluminium_3mm(SHORT, f"controller.law={law}", *more)


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    folder = tmp_path_factory.mktemp("twin")
    (folder / "twin.py").write_text(TWIN)
    return recorded(folder / "twin.py", folder / "a.mcap", Transport.COMPILED)


def recorded(law: Path, path: Path, transport: Transport) -> Recording:
    scene = scene_of(law, "controller.gain=2e6", "controller.latency_us=2")
    return run_recorded(scene, path, transport)


@pytest.mark.parametrize("transport", list(Transport))
def test_it_runs_as_the_same_law_in_python(unit, twin, transport, tmp_path):
    found = recorded(unit, tmp_path / "b.mcap", transport)
    assert found.force.arrays["force_n"].max() > 5.0
    assert first_difference(found, twin) is None


def test_its_parameters_are_scene_keys(unit):
    law = loaded_law(scene_of(unit))
    assert law.senses == "xi"
    assert law.keys.model_fields["gain"].description == "force by depth"
    assert scene_of(unit, "controller.gain=3").scene.controller.keys.gain == 3.0
    with pytest.raises(SceneError, match=r"controller\.gian"):
        scene_of(unit, "controller.gian=3")


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("if t > 1.05e-5: self.force = float('nan')", "at sample 11, commanded nan N"),
        ("if t > 1.05e-5: raise RuntimeError('no')", "at sample 11, failed: fmi2DoStep failed"),
    ],
)
def test_a_unit_that_fails_ends_the_run(fault, sentence, tmp_path):
    law = built(tmp_path, fault)
    words = ["--out", tmp_path / "a.mcap", *as_options([SHORT, f"controller.law={law}"])]
    refused(f"the law SpringLaw.fmu, {sentence}", "run", "aluminium-3mm", *words)


def test_what_is_no_law_is_refused(unit, tmp_path):
    with pytest.raises(SceneError, match="cannot be read: there is no such file"):
        scene_of(tmp_path / "none.fmu")
    text = tmp_path / "text.fmu"
    text.write_text("no archive")
    with pytest.raises(SceneError, match=r"text\.fmu: is not a co-simulation unit: "):
        scene_of(text)
    bare = tmp_path / "bare.fmu"
    with zipfile.ZipFile(unit) as full, zipfile.ZipFile(bare, "w") as file:
        file.writestr("modelDescription.xml", full.read("modelDescription.xml"))
    with pytest.raises(SceneError, match="was built for no platform, not for linux64"):
        scene_of(bare)
    second = 'self.register_variable(Real("kept", causality=Fmi2Causality.input))'
    two = built(tmp_path, more=second)
    assert loaded_law(scene_of(two)).senses == "xi"  # the one of a known name
    other = built(tmp_path, more=second, name="depth")
    with pytest.raises(SceneError, match=r"has the real inputs depth, kept\. Keep one"):
        scene_of(other)


UNITS = """<UnitDefinitions>
<Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>
<Unit name="mm/s"><BaseUnit m="1" s="-1" factor="0.001"/></Unit>
<Unit name="kN"><BaseUnit kg="1" m="1" s="-2" factor="1000"/></Unit>
<Unit name="furlong"/><Unit name="m"/><Unit name="N"/>
<Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>
</UnitDefinitions><LogCategories>"""


def changed(unit: Path, folder: Path, given: str = "", made: str = "", **texts: str) -> Path:
    """The unit with other units of its input and output, and other texts of its description."""
    path = folder / "changed.fmu"
    with zipfile.ZipFile(unit) as old, zipfile.ZipFile(path, "w") as file:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                text = data.decode().replace("<LogCategories>", UNITS)
                for causality, said in (("input", given), ("output", made)):
                    at = text.index("<Real", text.index(f'causality="{causality}"')) + 5
                    text = text[:at] + (f' unit="{said}"' if said else "") + text[at:]
                for before, after in texts.items():
                    assert before in text
                    text = text.replace(before, after)
                data = text.encode()
            file.writestr(name, data)
    return path


def test_values_are_in_the_units_of_the_unit(unit, tmp_path):
    def forces(path: Path) -> np.ndarray:
        bound = bound_law(scene_of(path))
        controller = Controller(bound, SignalPath(), 1e-6, 20, 1, 0)
        return np.asarray(answer_samples(controller, np.linspace(-1e-3, 0.0, 10)).forces)

    plain, other = forces(unit), forces(changed(unit, tmp_path, "mm", "kN"))
    assert other == pytest.approx(1e6 * plain)
    assert plain.max() > 100.0
    assert forces(changed(unit, tmp_path, "m", "N")) == pytest.approx(plain, rel=0.0, abs=0.0)
    speed = changed(unit, tmp_path, "mm/s", **{'"xi"': '"depth"'})
    assert loaded_law(scene_of(speed)).senses == "v_p"


@pytest.mark.parametrize(
    ("given", "made", "texts", "sentence"),
    [
        ("mm/s", "", {}, "the unit of xi is not that of xi"),
        ("furlong", "", {}, "the unit furlong of xi cannot be converted"),
        ("", "mm", {}, "the unit of force is not a force"),
        ("", "", {'"gain"': '"latency_us"'}, "its key latency_us is a key of the control loop"),
    ],
)
def test_what_would_be_misread_is_refused(unit, tmp_path, given, made, texts, sentence):
    with pytest.raises(SceneError, match=sentence):
        scene_of(changed(unit, tmp_path, given, made, **texts))


def test_a_unit_of_a_fixed_step_takes_that_step_alone(unit, tmp_path):
    said = 'canHandleVariableCommunicationStepSize="true"'
    fixed = changed(
        unit,
        tmp_path,
        **{
            said: said.replace("true", "false"),
            "<ModelVariables>": '<DefaultExperiment stepSize="5e-6"/><ModelVariables>',
        },
    )
    with pytest.raises(SceneError, match="has a fixed step of 5 us, but the scene samples every 1"):
        bound_law(scene_of(fixed))
    assert bound_law(scene_of(fixed, "sensors.every_steps=5"))
