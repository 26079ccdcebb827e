"""A new scheme, structure, quantity and stream need what docs/explanation/architecture.md says."""

import os
import shutil
from pathlib import Path

import pytest

from tests.hertzloop.commands import hertzloop, python
from tests.hertzloop.own_laws import EXAMPLES, ROOT
from tests.hertzloop.scenes import json_in

SCHEME = """
from pathlib import Path

Path("half.py").write_text('''
import sys
from typing import Any, NamedTuple

from benchmarks.schemes import discrete_gradient_kernels as whole
from benchmarks.schemes.discrete_gradient import DiscreteGradientPlant
from hertzloop.common.jit import kernel

HalfModel = NamedTuple("HalfModel", list(whole.DiscreteModel.__annotations__.items()))
close_balance, contact_energy = whole.close_balance, whole.contact_energy

@kernel(inline=True)
def step(model, state, f_a):
    return whole.step(model, state, 0.5 * f_a)

class HalfPlant(DiscreteGradientPlant):
    kernels: Any = sys.modules[__name__]

    @classmethod
    def refusal(cls, what, value=None):
        return "has no damper" if value == "viscous" else super().refusal(what, value)

    def _build_model(self):
        return HalfModel(*super()._build_model())
''')
from tests.hertzloop.with_lines import with_line

with_line(
    "hertzloop.plant.schemes.registry", '    "thesis2008": Scheme(',
    '    "half": Scheme("half:HalfPlant"),\\n',
)
import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.loop.in_process import record_in_process
from hertzloop.results.verification import verify
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.recordings.reader import read
from benchmarks.schemes.discrete_gradient import SCHEME
from hertzloop.plant.schemes.registry import SCHEMES

SCHEMES["whole"] = SCHEME  # as a program adds one, also once scenes have been loaded
half, whole = (
    load("aluminium-3mm", [
        f"run.scheme={scheme}", "run.duration_s=0.0013", "run.accuracy=0.1",
        "controller.law=constant", f"controller.force_n={force}", "controller.duration_us=50",
    ])
    for scheme, force in (("half", 4), ("whole", 2))
)
for settings, why in (
    (["contact.damping=viscous", "contact.viscous_n_s_m=1"], "'half', which has no damper. Remove"),
    (["plate.tail=damped"], "not supported by run.scheme = 'half', which does not have it"),
):
    with pytest.raises(SceneError, match=why):
        load("aluminium-3mm", ["run.scheme=half", *settings])
found = simulate(half).truth
assert np.array_equal(found[:5], simulate(whole).truth[:5])
record_in_process(half, Path("a.mcap"), compiled=True)
recording = read(Path("a.mcap"))
assert recording.problems == []
assert np.array_equal(recording.truth.arrays["xi_m"], found[0])
assert verify(half, found).penetration < 0.1
"""


STRUCTURE = """
from pathlib import Path

Path("own.py").write_text('''
from dataclasses import dataclass

import numpy as np

from hertzloop.common.protocols import Structure


@dataclass(frozen=True)
class Own(Structure):
    material: object
    thin: object
    measured: np.ndarray

    def modes_below(self, frequency_hz):
        return self.thin.modes_below(frequency_hz)

    def modes(self, omega_max, contact_m, actuator_m):
        return self.thin.modes(omega_max, contact_m, actuator_m)

    def residual_flexibility_m_n(self, omega_max, point_m=None):
        return self.thin.residual_flexibility_m_n(omega_max, point_m)

def made(description):
    return Own(description.material, description.thin_plate, np.linspace(0.0, 1.0, 7))
''')
from tests.hertzloop.with_lines import with_line

where = "hertzloop.plant.structures.registry"
with_line(where, '    "modes": Kind(', '    "own": Kind("own:made"),\\n')
from dataclasses import replace

import numpy as np
import pytest

from hertzloop.scene.loading import load
from hertzloop.plant.plant import modes_of
from hertzloop.plant.schemes.factory import plant_at_start
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant import state_kernels
from hertzloop.plant.time_series import XI
from hertzloop.closed_loop.parts import series_under
from hertzloop.plant.structures.registry import STRUCTURES, Description, structure
from tests.plant.rigs import spec

assert load("aluminium-3mm", ["plate.theory=own"]).plate.theory == "own"
STRUCTURES["later"] = STRUCTURES["own"]  # as a program adds one, also once scenes have been loaded
assert load("aluminium-3mm", ["plate.theory=later"]).plate.theory == "later"
with pytest.raises(ValueError, match="plate.theory"):
    load("aluminium-3mm", ["plate.theory=modes"])
known = spec(limit_hz=20e3)
thin = known.plate
described = Description(thin.material, thin.size_m, thin.thickness_m, thin.loss_factor)
own = replace(known, plate=structure("own", described))
assert structure("own", described) is own.plate
assert len(modes_of(own).omega) == len(modes_of(known).omega)
with pytest.raises(ValueError, match="simply supported plate"):
    own.simply_supported
for scheme, row in SCHEMES.items():
    if not row.accepts("plate.edges", "cccc"):
        continue
    gaps = []
    for each in (own, known):
        each = replace(each, residual_flexibility=row.accepts("plate.tail", "spring"))
        plant = plant_at_start(each, scheme, 200)
        gaps.append(series_under(plant, np.zeros(200))[XI])
        assert plant.state.counts[state_kernels.CONTACT_STEPS] > 0
        assert abs(plant.close_balance().energy_residual) < 1e-12
    assert np.array_equal(*gaps)
"""

QUANTITY = """
from tests.hertzloop.with_lines import with_line

with_line(
    "hertzloop.scene.quantities", '    "v_p": SensedQuantity(',
    '    "xi_p": SensedQuantity("m", "sampled place of the plate", state_kernels.XI_P, '
    'lambda e: _either_way(e.rigid_m), lambda t: -0.1 * t.gap_m),\\n',
)
from pathlib import Path

import numpy as np

from hertzloop.loop.simulate import simulate
from hertzloop.loop.in_process import record_in_process
from hertzloop.processes.law_trial import try_law
from hertzloop.views.labels import export_labels
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.recordings.reader import read
from hertzloop.recordings.replay.plots import plots

Path("mine.py").write_text(
    "senses = 'xi_p'\\n\\ndef command(p, s, samples, i):\\n    return -1e5 * samples[i]\\n"
)
settings = ["run.duration_s=0.0016", "controller.law=mine.py"]
scene = load("aluminium-3mm", settings)
assert scene.scene.sensors.quantity == "xi_p"
assert try_law(scene) == ""
found = simulate(scene)
assert np.ptp(found.values) > 1e-7
assert np.array_equal(found.values, found.truth[2])

coded = load("aluminium-3mm", [*settings, "sensors.bits=12"])
record_in_process(coded, Path("a.mcap"), compiled=False)
recording = read(Path("a.mcap"))
assert recording.problems == []
assert abs(recording.daq.values - recording.truth.arrays["xi_p_m"]).max() < 1e-7
assert export_labels("xi_p")["daq_value"] == ("m", "sampled place of the plate")
gap = next(plot for plot in plots(recording, []) if plot.key == "gap")
assert [curve.name for curve in gap.curves][-1] == "measured"
try:
    load("aluminium-3mm", [*settings, "sensors.quantity=v_p"])
except SceneError as error:
    assert "needs 'xi_p'" in str(error)
"""

STREAM = """
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

import hertzloop.bus.messages_pb2 as messages
from tests.hertzloop.with_lines import with_line

# What protoc would make of it.
file = descriptor_pb2.FileDescriptorProto(name="speed.proto", package="hertzloop", syntax="proto3")
block = file.message_type.add(name="SpeedBlock")
kinds = descriptor_pb2.FieldDescriptorProto
for number, name, kind in (
    (1, "run_id", kinds.TYPE_FIXED64), (2, "sequence", kinds.TYPE_UINT64),
    (3, "first_step", kinds.TYPE_UINT64), (4, "step_ns", kinds.TYPE_UINT32),
    (16, "speed_m_s", kinds.TYPE_DOUBLE),
):
    label = kinds.LABEL_REPEATED if number >= 16 else kinds.LABEL_OPTIONAL
    block.field.add(name=name, number=number, type=kind, label=label)
pool = descriptor_pool.DescriptorPool()
pool.Add(file)
SpeedBlock = message_factory.GetMessageClass(pool.FindMessageTypeByName("hertzloop.SpeedBlock"))
messages.SpeedBlock = SpeedBlock
with_line(
    "hertzloop.bus.streams", '        Stream("balance"',
    '        Stream("speed", PLANT, messages.SpeedBlock, "/speed", compared=True),\\n',
)
from pathlib import Path

import numpy as np

from hertzloop.bus.streams import RECORDER, SUBSCRIPTIONS
from hertzloop.closed_loop import exchange as k
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.plant_streams import PlantStreams
from hertzloop.scene.setup import load
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read

assert "speed" in SUBSCRIPTIONS[RECORDER]
send_truth, factor = PlantStreams.send_truth, 1.0

def send_both(self):
    counts = self.unsent.counts
    first, end = int(counts[k.TRUTH_FIRST]), int(counts[k.TRUTH_END])
    if end > first:
        speed = factor * self.unsent.truth[3, : end - first]
        header = SpeedBlock(first_step=first, step_ns=self.setup.run.step_ns)
        self.publisher.send("speed", header, {"speed_m_s": speed})
    send_truth(self)

PlantStreams.send_truth = send_both
scene = load("aluminium-3mm", ["run.duration_s=0.0016"])
found = []
for name, compiled in (("a", True), ("b", False), ("c", True)):
    factor = 2.0 if name == "c" else 1.0
    record_in_process(scene, Path(f"{name}.mcap"), compiled=compiled)
    found.append(read(Path(f"{name}.mcap")))
    assert found[-1].problems == []
assert np.array_equal(found[0].speed.arrays["speed_m_s"], found[0].truth.arrays["v_p_m_s"])
assert found[0].speed.messages == found[0].truth.messages
assert first_difference(found[0], found[1]) is None
assert first_difference(found[0], found[2]).startswith("speed.speed_m_s differs first at step")
"""


def run(script: str, folder: Path, **environment: str) -> None:
    before = f"import sys; sys.path.insert(0, {str(ROOT)!r})\n"
    python("-c", before + script, cwd=folder, env=os.environ | environment)


@pytest.mark.full
def test_a_scheme_is_a_file_and_a_row_of_one_table(tmp_path):
    """Setup, transports and `--verify` follow."""
    # Kernels of its own: other processes could not read those of its types.
    run(SCHEME, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kernels"))


def test_a_structure_is_a_file_and_a_row_of_one_table(tmp_path):
    """It may hold arrays; its modes do in every scheme that supports more than a simply supported
    plate."""
    run(STRUCTURE, tmp_path)


@pytest.mark.full
def test_the_command_line_takes_the_structure_of_the_examples(tmp_path):
    """A beam, to which nothing applies that needs a plate at the contact point."""
    examples = ROOT / "docs" / "examples"
    # Python imports this in every process that it starts.
    (tmp_path / "sitecustomize.py").write_text(
        f"import sys\nsys.path[:0] = [{str(ROOT)!r}, {str(examples)!r}]\n"
        "from tests.hertzloop.with_lines import with_line\n"
        "with_line('hertzloop.plant.structures.registry', '    \"modes\": Kind(', "
        '\'    "beam": Kind("own_beam:made"),\\n\')\n'
    )

    def command(*words: str) -> str:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        scene = str(examples / "own_beam.toml")
        return hertzloop(*words, scene, cwd=tmp_path, env=environment).stdout

    assert "Control reduces plate energy" in command("run", "--json", "run.json", "--out", "a.mcap")
    ran = json_in(tmp_path / "run.json")
    assert ran["struck"]["name"] == "a simply supported beam"
    assert abs(ran["residuals"]["energy"]) < 1e-12
    checked = command("scene", "check")
    assert " nan " not in checked
    assert "Not evaluated: contact against plate" in checked
    assert "3 cases: 3 run" in command("sweep", "--over", "controller.latency_us=0:2:1")


def test_a_quantity_is_a_row_of_one_table(tmp_path):
    """Setup, law and its trial, converter, recording, export and replay follow."""
    run(QUANTITY, tmp_path)


def test_a_stream_is_a_message_and_a_row_of_one_table(tmp_path):
    """Numbering, counts, recorder, reader and comparison follow."""
    run(STREAM, tmp_path)


TABLE = """
from dataclasses import dataclass

import numpy as np
from own_beam import Beam, made

@dataclass(frozen=True)
class TableBeam(Beam):
    {field}

def table(description):
    beam = made(description)
    return TableBeam(**vars(beam), {value})
"""
# One program, since a structure is added to the table of a process.
SCRIPT = """
import hertzloop
from hertzloop.plant.structures.registry import STRUCTURES, Kind

STRUCTURES.update(beam=Kind("own_beam:made"), array=Kind("array_beam:table"),
                  listed=Kind("listed_beam:table"))
for theory in STRUCTURES:
    if theory not in ("beam", "array", "listed"):
        continue
    scene = hertzloop.load("own_beam.toml", {"plate.theory": theory, "contact.plasticity": "none"})
    energy_j = hertzloop.simulate(scene).metrics.first_impact.plate_energy_j
    swept = hertzloop.sweep(scene, {"controller.latency_us": [0, 2]}).plate_energy_db.values
    print(energy_j, *swept)
"""


@pytest.mark.full
def test_a_structure_may_have_arrays_in_its_fields(tmp_path):
    """A table of its own changes nothing of a beam."""
    for name in ("own_beam.py", "own_beam.toml"):
        shutil.copy(EXAMPLES / name, tmp_path)
    for name, field, value in (
        ("array", "table: np.ndarray", "table=np.arange(5.0)"),
        ("listed", "table: list", "table=[np.eye(2), {'x': 1.0}]"),
    ):
        (tmp_path / f"{name}_beam.py").write_text(TABLE.format(field=field, value=value))
    beam, array, listed = python("-c", SCRIPT, cwd=tmp_path).stdout.splitlines()
    assert beam == array == listed
    assert float(beam.split()[0]) == pytest.approx(0.489429e-3, rel=1e-6)
