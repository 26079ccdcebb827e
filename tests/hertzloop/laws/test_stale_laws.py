"""A law's compiled code is never older than what it was made of, and a law repeats its commands."""

from pathlib import Path

import pytest

import hertzloop
from hertzloop.controller.loading import compiled
from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import find
from hertzloop.scene.errors import SceneError
from tests.commands import refused
from tests.hertzloop.own_laws import EXAMPLES, build, needs_cc
from tests.tiers import default

pytestmark = pytest.mark.usefixtures("here")

SENSES = 'senses = "contact_force"\n'
COMMAND = "\ndef command(p, s, samples, i):\n    return {} * samples[i]\n"
SHORT = {"run.duration_s": 0.0012, "run.plate_model": "modal", "controller.law": "mine.py"}


def peak_n(law: str = "mine.py") -> float:
    scene = hertzloop.load("aluminium-3mm", SHORT | {"controller.law": law})
    return hertzloop.simulate(scene).impacts[0].peak_force_n


def write(files: dict[str, str], gain: float) -> None:
    for name, text in files.items():
        path = Path(name)
        path.parent.mkdir(exist_ok=True)
        path.write_text(text.replace("GAIN", str(gain)))


def law(before: str, gain: str = "K") -> str:
    return SENSES + before + COMMAND.format(gain)


READS = "from pathlib import Path\nHERE = Path(__file__).parent\n"
GIVES = "def k():\n    return K\n"
# The files of a law whose gain is somewhere else each time.
LAWS = {
    "text file": {
        "mine.py": law(f"{READS}K = float((HERE / 'k.txt').read_text())"),
        "k.txt": "GAIN",
    },
    "attributes of a module": {
        "mine.py": law("import own_lib.gains", "own_lib.gains.K"),
        "own_lib/__init__.py": "",
        "own_lib/gains.py": "K = GAIN\n",
    },
    "function that Numba keeps": {
        "mine.py": law("from own_first import k", "k()"),
        "own_first.py": "import numba\nfrom own_second import K\n\n"
        f"@numba.njit(cache=True)\n{GIVES}",
        "own_second.py": "K = GAIN\n",
    },
    "prepare": {
        "mine.py": f"{SENSES}from collections import namedtuple\n\ndef prepare(keys, about):\n"
        "    return namedtuple('P', 'k')(float(open('k.txt').read()))\n" + COMMAND.format("p.k"),
        "k.txt": "GAIN",
    },
}


def plain(gain: float) -> float:
    Path("plain.py").write_text(law(f"K = {gain}"))
    return peak_n("plain.py")


@pytest.mark.parametrize("kind", LAWS)
def test_the_gain_is_what_it_is_now(kind, monkeypatch):
    """In one process, and with code that another process has left on the disk."""
    for gain in (0.2, 0.5, 0.2):
        write(LAWS[kind], gain)
        assert peak_n() == plain(gain)
        monkeypatch.setattr(compiled, "_ENTRIES", {})


@needs_cc
def test_a_library_that_was_built_again(here):
    """In one process, whose system keeps what it has loaded of that path; and back to the first."""
    text = (EXAMPLES / "low_passed.c").read_text()
    peaks = []
    for gain in ("0.2", "0.5", "0.2"):
        (here / "mine.c").write_text(text.replace("p->kappa * samples", f"{gain} * samples"))
        peaks.append(peak_n(build(here, here / "mine.c").name))
    assert peaks[0] == peaks[2] != peaks[1]


def test_a_scene_follows_its_law():
    """A scene that is kept while its law is edited is simulated under the law as it is now."""
    write(LAWS["text file"], 0.2)
    scene = hertzloop.load("aluminium-3mm", SHORT)
    digests = [scene.controller.law_digest]
    for gain in (0.2, 0.5):
        write(LAWS["text file"], gain)
        run = hertzloop.simulate(hertzloop.vary(scene, {"controller.latency_us": 0}))
        assert run.impacts[0].peak_force_n == plain(gain)
        digests.append(run.scene.controller.law_digest)
    assert digests[0] == digests[1] != digests[2]
    asked = hertzloop.load("aluminium-3mm", SHORT | {"controller.law_digest": digests[-1]})
    write(LAWS["text file"], 0.3)
    with pytest.raises(SceneError, match="other values were read"):
        hertzloop.simulate(asked)


def test_the_environment(monkeypatch):
    Path("mine.py").write_text(law("import os\nK = float(os.environ['OWN_GAIN'])"))
    for gain in (0.2, 0.5):
        monkeypatch.setenv("OWN_GAIN", str(gain))
        assert peak_n() == plain(gain)


VALUES = {
    "dict": ("CONFIG = {'k': GAIN}\n", "CONFIG['k']"),
    "closure": (
        "def made(k):\n    def inner():\n        return k\n    return inner\nCONFIG = made(GAIN)\n",
        "CONFIG()",
    ),
    "default": ("def k(k=GAIN):\n    return k\n", "k()"),
}


@pytest.mark.parametrize("kind", VALUES)
def test_values_of_any_kind_identify_a_law(kind):
    before, gain = VALUES[kind]
    reads = f"{READS}GAIN = float((HERE / 'k.txt').read_text())\n"
    digests = []
    for value in (0.2, 0.5, 0.2):
        write({"mine.py": law(reads + before, gain).replace("GAIN", "G_"), "k.txt": "GAIN"}, value)
        assert peak_n() == plain(value)
        digests.append(find("mine.py").digest)
    assert digests[0] == digests[2] != digests[1]
    assert len({digest[:16] for digest in digests}) == 1


def test_prepare_that_changes_a_global():
    Path("mine.py").write_text(
        "from collections import namedtuple\nimport numpy as np\nfrom hertzloop.law import Keys\n"
        "G = np.array([0.2])\n\nclass Parameters(Keys):\n    gain: float = 0.2\n\n"
        "def prepare(keys, about):\n    G[0] = keys.gain\n    return namedtuple('P', 'k')(1.0)\n"
        + law("", "G[0]")
    )
    assert peak_n() == plain(0.2)
    scene = hertzloop.load("aluminium-3mm", SHORT | {"controller.gain": 0.5})
    with pytest.raises((LawError, SceneError), match="prepare changes the global G"):
        hertzloop.simulate(scene)


# Laws that are no functions of their keys, their state and their samples.
UNREPEATABLE = {
    "counter": ("N = 0\n", "    global N\n    N += 1\n    return 1e-3 * N", "is not deterministic"),
    "numpy.random": (
        "import numpy as np\n",
        "    return np.random.random()",
        "is not deterministic",
    ),
    "when loaded": (
        "import numpy as np\nK = np.random.default_rng().random()\n",
        "    return K * samples[i]",
        "K has another value each time",
    ),
    "when prepared": (
        "import random\nfrom collections import namedtuple\n\ndef prepare(keys, about):\n"
        "    return namedtuple('P', 'k')(random.random())\n",
        "    return p.k * samples[i]",
        "prepare returns other constants",
    ),
}


@pytest.mark.parametrize(
    "kind", default(UNREPEATABLE, quick=("counter", "numpy.random", "when loaded"))
)
def test_a_law_that_does_not_repeat_its_commands(kind):
    before, body, why = UNREPEATABLE[kind]
    text = f"{SENSES}{before}\ndef command(p, s, samples, i):\n{body}\n"
    Path("mine.py").write_text(text)
    refused(why, "run", "--set", "controller.law=mine.py", "--set", "run.duration_s=0.0012")
