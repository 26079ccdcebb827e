"""Requirements: what they check, as rows of pytest too, and their files."""

import os
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from hertzloop.controller import laws
from hertzloop.scene.errors import SceneError
from hertzloop.studies.budget.requirements.check import check
from hertzloop.studies.budget.requirements.requirement import read_requirements
from tests.commands import refused, succeed
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import ROOT
from tests.hertzloop.scenes import json_in

REQUIREMENTS = """
[hertzloop]
law = "force_feedback"

[[requirement]]
name = "quiet"
scene = "aluminium-3mm"
set = { "run.duration_s" = 0.0016 }
goal = "plate_energy_db <= -3"
expect = { plate_energy_db = -9.044 }

[[requirement]]
name = "late"
scene = "aluminium-3mm"
set = { "run.duration_s" = 0.0016, "controller.latency_us" = 12 }
goal = "plate_energy_db <= -0.1"
"""


@pytest.fixture
def requirements(tmp_path):
    path = tmp_path / "requirements.toml"
    path.write_text(REQUIREMENTS)
    return path


def test_requirements_say_what_holds_and_what_fails(pool, requirements, tmp_path):
    quiet, late = (check(pool, one) for one in read_requirements(requirements))
    assert quiet.passed
    assert "to spare" in " ".join(quiet.holds)
    assert not late.passed
    assert "is missed by" in late.fails[0]
    assert "controller.latency_us=12" in late.command
    requirements.write_text(REQUIREMENTS.replace("-9.044", "-9.08"))  # more than its digits
    assert not check(pool, read_requirements(requirements)[0]).passed


@pytest.mark.parametrize(
    ("force", "passes"),
    [
        ("0.5 * (value * p.gain + value * p.gain)", True),
        ("-p.gain * value", False),
        ("1.01 * p.gain * value", False),
        ("p.gain * samples[max(i - 1, 0)]", False),
    ],
)
def test_a_fault_in_a_law_fails_and_an_equivalent_rewrite_passes(pool, requirements, force, passes):
    shipped = Path(laws.__file__).with_name("force_feedback.py").read_text()
    law = requirements.with_name("law.py")
    law.write_text(shipped.replace("p.gain * value", force))
    requirements.write_text(REQUIREMENTS.replace('law = "force_feedback"', 'law = "law.py"'))
    assert check(pool, read_requirements(requirements)[0]).passed == passes


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("x = 1\n[hertzloop]", "x is unknown"),
        ("[hertzloop]\nlaws = 'a.py'", "hertzloop.laws is"),
        ("[[requirement]]\nname = 'a'", r"no table \[hertzloop\]"),
        ("[hertzloop]", "Add at least one"),
        ("[hertzloop]\n[[requirement]]\nname = 'a'\nscene = 'b'", "needs goal"),
        ("[hertzloop]\n[[requirement]]\nname = 'a'\nscene = 'b'\ngoal = 'x <= 1'", "not a metric"),
    ],
)
def test_requirements_that_cannot_be_read_are_refused(tmp_path, text, word):
    path = tmp_path / "requirements.toml"
    path.write_text(text)
    with pytest.raises(SceneError, match=word):
        read_requirements(path)


ELASTIC = ["-p", "tests.elastic_scenes"]


def run_pytest(folder, *words, code=1):
    """What pytest prints with the plug-in in a folder."""
    plugins = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    plugins.pop("PYTEST_XDIST_WORKER", None)
    plugins["PYTHONPATH"] = os.pathsep.join([str(ROOT), plugins.get("PYTHONPATH", "")])
    words = ("-m", "pytest", *words, "-p", "hertzloop.pytest_plugin", "-q")
    return python(*words, cwd=folder, env=plugins, code=code).stdout


def test_rows_are_tests_of_pytest(requirements):
    (requirements.parent / "test_mine.py").write_text(
        "def test_run(hertzloop_run):\n"
        "    changes = {'run.duration_s': 0.0016}\n"
        "    found = hertzloop_run('aluminium-3mm', 'force_feedback', changes)\n"
        "    assert found.plate_energy_db < -9\n"
    )
    told = run_pytest(requirements.parent, *ELASTIC, "--junitxml", "report.xml")
    assert "1 failed, 2 passed" in told
    suite = ET.parse(requirements.with_name("report.xml")).getroot()[0]
    assert (suite.get("tests"), suite.get("failures")) == ("3", "1")
    (failure,) = suite.iter("failure")
    assert "Reproduce: hertzloop run aluminium-3mm" in failure.text
    assert "Reproduce: hertzloop run aluminium-3mm" in told
    assert "Traceback" not in told


UNSTABLE_ROW = """
[[requirement]]
name = "{}"
scene = "aluminium-3mm"
set = {{ "run.duration_s" = 0.0016, "controller.kappa" = 0.1 }}
goal = "plate_energy_db <= 20"
"""


@pytest.mark.full
def test_pytest_names_an_instability_that_no_run_shows(requirements):
    quiet, coarse = (UNSTABLE_ROW.format(name) for name in ("quiet", "coarse"))
    head = '[hertzloop]\nlaw = "velocity_feedback"\n'
    requirements.write_text(f"{head}{quiet}{coarse}limit = {{ bits = 12 }}\n")
    told = run_pytest(requirements.parent, *ELASTIC)
    assert "1 failed, 1 passed, 1 warning" in told
    assert "bits: tolerated none (unstable loop), required 12" in told
    assert "PytestWarning: quiet: the linear loop is unstable (grows" in told


OF_ANOTHER_TOOL = 'title = "Other [hertzloop]"\n[[requirement]]\nid = "REQ_1"\n'


@pytest.mark.parametrize("text", [OF_ANOTHER_TOOL, "[["])
def test_a_repository_of_others_is_left_alone(tmp_path, text):
    (tmp_path / "requirements.toml").write_text(text)
    (tmp_path / "test_theirs.py").write_text(
        "import sys\n"
        "def test_theirs():\n"
        "    heavy = {'numpy', 'numba', 'zenoh', 'xarray', 'pydantic', 'hertzloop.scene'}\n"
        "    assert 'hertzloop.pytest_plugin' in sys.modules\n"
        "    assert not heavy & set(sys.modules)\n"
    )
    assert "1 passed" in run_pytest(tmp_path, code=0)


def test_the_command_ends_as_documented(requirements):
    refused("1 of 2 requirements hold", "budget", "--check", requirements, code=1)
    refused("has no limits", "budget", "--law", "off")


@pytest.mark.full
def test_both_spans_stand_in_one_table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["budget", "oak-20mm", "--quick", "--no-real-plant", "--workers", "1"]
    words += ["--only", "latency_us", "--json", "a.json"]
    one = succeed(*words)
    assert "changes by -4.2 dB in the first impact and by -2.0 dB over all contacts" in one
    assert "--span both" in one
    both = succeed(*words, "--span", "both")
    assert "the first impact" in both
    assert "the whole run" in both
    data = json_in("a.json")
    limits = [data[of]["latency_us"]["value"] for of in ("limits", "other_span")]
    assert None not in limits
    assert limits[0] != limits[1]
    assert data["other_span_db"] == pytest.approx(-2.0, abs=0.05)
