"""Laws of one's own, from a folder that holds nothing else: Python files, packages, C libraries."""

import os
import re
import shutil

import pytest

from hertzloop.api import runs, scenes
from hertzloop.bus.streams import CONTROLLER
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.results.recorded import reported_law
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load, parse
from hertzloop.scene.toml import to_toml
from tests.commands import refused, succeed
from tests.hertzloop.commands import hertzloop
from tests.hertzloop.lanes import Pair
from tests.hertzloop.own_laws import EXAMPLES, ROOT, SHORT, build, needs_cc, write_law
from tests.hertzloop.scenes import aluminium_3mm, json_in, run_recorded
from tests.tiers import default

LIMIT = ["controller.full_scale_n=20", "controller.latency_us=2", SHORT]


@needs_cc
@pytest.mark.parametrize("transport", default(["compiled", "inprocess", "zenoh"], ["compiled"]))
def test_the_example_in_python_and_in_c_has_the_same_bytes(here, transport):
    shutil.copy(EXAMPLES / "low_passed.py", here)
    build(here, EXAMPLES / "low_passed.c")
    laws = ("low_passed.py", "low_passed.so")
    scenes = [aluminium_3mm(*LIMIT, f"controller.law={law}") for law in laws]
    first = run_recorded(scenes[0], here / "a.mcap")
    assert first.force.arrays["force_n"].max() == 20.0  # at the limit, so anti-windup acts
    for scene in scenes:
        assert first_difference(run_recorded(scene, here / "b.mcap", transport), first) is None


@pytest.mark.parametrize(
    ("law", "transport"), [("slope_threshold", "compiled"), ("force_feedback", "zenoh")]
)
def test_a_shipped_law_as_a_file_of_ones_own(here, law, transport):
    shutil.copy(ROOT / "controller" / "laws" / f"{law}.py", here / "mine.py")
    settings = [SHORT, "controller.latency_us=3", "sensors.bits=12"]
    same = run_recorded(aluminium_3mm(*settings, f"controller.law={law}"), here / "a.mcap")
    scene = aluminium_3mm(*settings, "controller.law=mine.py")
    mine = run_recorded(scene, here / "b.mcap", transport)
    assert mine.force.arrays["force_n"].any()
    assert first_difference(mine, same) is None
    assert reported_law(mine) == ("mine.py", loaded_law(scene).digest)
    assert mine.law_source == (here / "mine.py").read_text()


PROMISES = {
    "trigger_level": "def trigger_level(p, s):\n    return 0.0\n",
    "known_ahead": "def known_ahead(p, s, samples, i):\n    return i < 50\n"
    "def command_ahead(p, s, samples, i, j):\n    return 0.0\n",
}


@pytest.mark.parametrize("promise", default(PROMISES, ["known_ahead"]))
def test_the_sign_of_a_zero_depends_on_no_transport(here, promise):
    """Of a law that commands -0.0 N where it has promised 0."""
    command = "def command(p, s, samples, i):\n    return -5.0 if samples[i] <= 0.0 else -0.0\n"
    (here / "mine.py").write_text(command + PROMISES[promise])
    scene = aluminium_3mm(SHORT, "controller.law=mine.py")
    first = run_recorded(scene, here / "a.mcap")
    for transport in ("inprocess", "zenoh"):
        run = run_recorded(scene, here / f"{transport}.mcap", transport)
        assert first_difference(run, first) is None


CLASSES = """
class Half:
    senses = "contact_force"
    @staticmethod
    def command(p, s, samples, i):
        if samples[i] != 0.0:
            s.mode = 2
        return 0.5 * samples[i]
"""


@pytest.mark.full
def test_by_class_package_and_entry_point(here):
    package = here / "acme_laws"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "halves.py").write_text(CLASSES)
    about = here / "acme_laws-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-laws\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[hertzloop.laws]\nhalf = acme_laws.halves:Half\n")
    path = f"{ROOT}{os.pathsep}{here}"
    references = ("acme_laws/halves.py:Half", "acme_laws.halves:Half", "half", "force_feedback")
    for number, law in enumerate(references):
        words = ["run", "aluminium-3mm", "--transport", "compiled", "--set", SHORT]
        settings = ["--set", f"controller.law={law}"]
        settings += ["--set", "controller.kappa=0.5"] if law == "force_feedback" else []
        words += ["--out", f"{number}.mcap"]
        hertzloop(*words, *settings, cwd=here, env={**os.environ, "PYTHONPATH": path})
    for number in range(3):
        assert first_difference(read(here / f"{number}.mcap"), read(here / "3.mcap")) is None


@pytest.mark.full
def test_sweep_and_tune(here):
    shutil.copy(EXAMPLES / "low_passed.py", here / "mine.py")
    fixed = ["aluminium-3mm", "--set", "controller.law=mine.py", "--set", SHORT]
    over = ["--over", "controller.kappa=0.2,0.6", "--over", "controller.corner_hz=5e3,50e3"]
    succeed("sweep", *fixed, *over, "-o", "r.csv", "--workers", "2")
    header = json_in(here / "r.csv.json")
    (about,) = header["laws"].values()
    assert about["source"] == (here / "mine.py").read_text()
    tuned = ["tune", "aluminium-3mm", "--law", "mine.py", "--set", SHORT, "--json", "t.json"]
    small = ["--generations", "1", "--population", "4", "--minimise", "plate_energy_db"]
    succeed(*tuned, *small)
    (best,) = json_in(here / "t.json")["front"]
    assert set(best["values"]) == {"controller.law", "controller.kappa", "controller.corner_hz"}


@pytest.mark.full
def test_what_numba_does_not_know_runs_as_python_and_says_so(here):
    write_law(here)
    path = write_law(here, name="slow.py")
    text = path.read_text().replace(
        "p.share *", "{'share': p.share}.get('share') * float(str(1.0)) *"
    )
    path.write_text(text)
    recordings = []
    for law in ("mine.py", "slow.py"):
        words = ["--transport", "compiled", "--set", SHORT, "--out", f"{law}.mcap"]
        told = succeed("run", "aluminium-3mm", *words, "--set", f"controller.law={law}")
        cost = re.search(r"runs as Python, ([0-9.]+) us", told)
        assert (cost is not None and float(cost[1]) > 0.0) == (law == "slow.py")
        recordings.append(read(here / f"{law}.mcap"))
    assert recordings[0].force.arrays["force_n"].any()
    assert first_difference(*recordings) is None
    slow = aluminium_3mm(SHORT, "controller.law=slow.py")
    assert first_difference(run_recorded(slow, here / "z.mcap", "zenoh"), recordings[0]) is None


def test_keys_of_a_law_of_ones_own(here):
    write_law(here)
    mine = ["controller.law=mine.py"]
    scene = aluminium_3mm(*mine, "controller.share=0.25")
    assert scene.scene.controller.keys.share == 0.25
    assert parse(to_toml(scene.scene)) == scene
    assert aluminium_3mm(*mine) == aluminium_3mm().vary({"controller.law": "mine.py"})
    assert scene.vary({"controller.law": "slope_threshold"}) == aluminium_3mm()
    for setting, words in {
        "controller.shar=1": "controller.shar: unknown scene key. Did you mean share?",
        "controller.share=2": "controller.share = 2: is not possible",
        "controller.share=nan": "controller.share",
        "controller.fade_us=20": "fade_us = 20: has no effect on .*, whose keys are: share",
        "sensors.quantity=xi": "needs 'contact_force'",
    }.items():
        with pytest.raises(SceneError, match=words.replace("?", r"\?")):
            aluminium_3mm(*mine, setting)
    with pytest.raises(SceneError, match="share: unknown scene key"):
        aluminium_3mm("controller.share=0.25")


def test_a_law_beside_its_scene(here):
    folder = here / "scenes"
    folder.mkdir()
    write_law(folder)
    text = to_toml(aluminium_3mm().scene).replace('law = "slope_threshold"', 'law = "mine.py"')
    text = text.replace('quantity = "xi"', 'quantity = "auto"')
    (folder / "mine.toml").write_text(text)
    assert loaded_law(load("scenes/mine.toml")).path == folder / "mine.py"
    write_law(here, "s.largest_n += 0.0")
    assert loaded_law(load("scenes/mine.toml")).path == folder / "mine.py"


def test_a_controller_that_has_the_law_elsewhere(here):
    """It says at its end what the plant calls the law; another law it does not take for it."""
    folder = here / "there"
    folder.mkdir()
    write_law(here)
    there = write_law(folder)

    def run(timeout_s: float) -> Pair:
        pair = Pair(aluminium_3mm(SHORT, "controller.law=mine.py"), timeout_s)
        pair.controller = ControllerNode(pair.ports[CONTROLLER], law=str(there))
        return pair.run()

    same = run(5.0)
    assert (same.fault, same.controller_fault) == ("", "")
    write_law(folder, "s.largest_n += 0.0")
    assert "Copy the same file to both sides" in run(1.0).controller_fault


def test_new_law_and_scene_run_as_they_are(here):
    for kind, name in (("law", "mine.py"), ("scene", "a scene.toml")):
        succeed(kind, "new", name)
    run = ["run", "a scene.toml", "--transport", "compiled", "--set", SHORT]
    succeed(*run, "--set", "controller.law=mine.py")
    recording = read(here / "a-scene.mcap")
    assert recording.force.arrays["force_n"].any()
    refused("mine.py exists", "law", "new", "mine.py")
    refused("mine.txt", "law", "new", "mine.txt")
    # The same start in C.
    if shutil.which("cc"):
        succeed("law", "new", "mine.c")
        build(here, here / "mine.c")
        scene = load("a scene.toml", [SHORT, "controller.law=mine.so"])
        assert first_difference(run_recorded(scene, here / "c.mcap"), recording) is None


def test_a_recording_outlives_its_law(here):
    path = write_law(here)
    run_recorded(aluminium_3mm(SHORT, "controller.law=mine.py"), here / "a.mcap")
    first = runs.read("a.mcap").metrics.first_impact
    for change in (lambda: write_law(here, "s.largest_n += 0.0"), path.unlink):
        change()
        recorded = runs.read("a.mcap")
        assert recorded.metrics.first_impact == first
        assert recorded.verdict
        with pytest.raises(SceneError, match=r"Copy the same file to both sides|no such file"):
            runs.simulate(recorded.scene)
        assert scenes.vary(recorded.scene, {"controller.law": "off"}).controller.law == "off"
    succeed("inspect", "a.mcap", "--json", "i.json")
    data = json_in(here / "i.json")
    assert data["complete"]
    assert len(data["impacts"]) == 1
    assert data["law"] == data["scene_law"] == "mine.py"
