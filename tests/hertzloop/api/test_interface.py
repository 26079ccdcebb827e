"""The Python interface: the same numbers as the command line's parts, labelled; the notebook."""

import re

import numpy as np
import pytest

import hertzloop
from hertzloop import api as interface
from hertzloop.loop.simulate import simulate
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.setup import resolve
from hertzloop.scene.toml import to_toml
from tests.commands import succeed
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import EXAMPLES, ROOT
from tests.hertzloop.scenes import json_in

PAGE = ROOT / "docs" / "how-to" / "python.md"
SHORT = {"run.duration_s": 0.0015, "controller.v_thr_m_s": -0.6}


@pytest.fixture(scope="module")
def scene():
    return hertzloop.load("aluminium-3mm", SHORT)


def test_a_run_in_memory_holds_the_loops_own_rows(scene):
    run, rows = hertzloop.simulate(scene), simulate(resolve(scene)).truth
    assert run.truth["xi_m"].values.tobytes() == rows[0].tobytes()
    assert run.truth["f_c_n"].attrs["units"] == "N"
    assert "xi_a_m" not in run.truth
    assert run.truth["time_s"].values[-1] == pytest.approx(0.0015 - 1e-6)
    assert run.impacts[0].plate_energy_j < run.without_control().impacts[0].plate_energy_j
    assert abs(run.energy_residual) < 1e-11
    assert run.samples.attrs["units"] == "m"


@pytest.mark.parametrize("transport", ["zenoh", "compiled"])
def test_every_transport_gives_the_same_run(scene, tmp_path, transport):
    recorded = hertzloop.run(scene, tmp_path / "a.mcap", transport=transport)
    memory = hertzloop.simulate(scene)
    assert recorded.truth.identical(memory.truth)
    assert recorded.samples.identical(memory.samples)
    assert recorded.impacts == memory.impacts
    assert recorded.noise == memory.noise
    np.testing.assert_array_equal(recorded.force.values, recorded.truth["f_a_n"].values)
    again = hertzloop.read(tmp_path / "a.mcap")
    assert again.truth.identical(recorded.truth)
    assert "contact 1 began" in {event.message for event in again.events}


@pytest.mark.full
def test_a_scene_may_be_given_by_name_or_file(tmp_path):
    source = tmp_path / "mine.toml"
    source.write_text(to_toml(resolve(hertzloop.vary("aluminium-3mm", SHORT)).scene))
    run = hertzloop.simulate(source)
    assert run.scene == hertzloop.vary("aluminium-3mm", SHORT)
    assert hertzloop.run(str(source), transport="compiled").impacts == run.impacts
    assert hertzloop.modes("aluminium-3mm").equals(hertzloop.modes(source))
    assert hertzloop.linear("aluminium-3mm").poles.size
    over = {"controller.latency_us": [0]}
    assert hertzloop.sweep(source, over).equals(hertzloop.sweep(run.scene, over))


@pytest.mark.full
def test_a_paced_run_tells_what_it_missed(scene, tmp_path):
    path = tmp_path / "a.mcap"
    paced = hertzloop.run(scene, path, pace=0.5)
    assert paced.pacing["pace"] == 0.5
    assert paced.pacing["late_forces"] == np.count_nonzero(paced.truth["held_steps"].values)
    assert paced.pacing["response_us"]["p50"] > 0.0
    assert hertzloop.read(path).pacing == paced.pacing
    assert hertzloop.simulate(scene).pacing is None


def test_a_printed_run_is_at_most_six_lines_with_the_verdict(scene):
    run = hertzloop.simulate(scene)
    lines = str(run).splitlines()
    assert 4 < len(lines) <= 6
    assert "aluminium-3mm" in lines[0]
    assert lines[1:] == run.verdict[:5]
    assert len(repr(run)) < 200


@pytest.mark.full
def test_the_package_shows_its_public_names_and_loads_them_late():
    """Every documented exception is there; `import hertzloop` alone loads nothing heavy."""
    code = (
        "import sys, hertzloop\n"
        "heavy = {'numpy', 'numba', 'xarray', 'pydantic'} & set(sys.modules)\n"
        "print(dir(hertzloop) == sorted(hertzloop.__all__), heavy)\n"
        "from hertzloop import *\n"
    )
    assert python("-c", code).stdout == "True set()\n"
    assert set(interface.__all__) | {"__version__"} == set(hertzloop.__all__)
    documented = set(re.findall(r"`(\w+(?:Error|Failed|Fault|Lost))`", PAGE.read_text())) - {
        "ValueError",
        "RuntimeError",
    }
    wanted = re.compile("(Error|Failed|Fault|Lost)$")
    assert documented == {name for name in hertzloop.__all__ if wanted.search(name)}
    assert all(issubclass(getattr(hertzloop, name), Exception) for name in documented)


def test_a_sweep_over_a_list_is_the_cases_of_single_runs(scene):
    table = hertzloop.sweep(
        scene, hertzloop.SweepRequest({"controller.latency_us": np.arange(3)}, workers=1)
    )
    assert list(table["controller.latency_us"].values) == [0, 1, 2]
    assert list(table["status"].values) == ["", "", ""]
    alone = metrics_of_case(resolve(hertzloop.vary(scene, {"controller.latency_us": 2})))
    assert table["digest"].values[2] == alone.digest


def test_tuning_finds_no_worse_than_the_published_setting():
    scene = hertzloop.load("aluminium-3mm", {"run.duration_s": 0.0016})
    request = hertzloop.TuneRequest(
        laws=["slope_threshold"],
        minimise=["plate_energy_db"],
        population=8,
        workers=1,
    )
    assert hertzloop.tune(scene, request, generations=3).best.metrics["plate_energy_db"] < 0.35


def test_a_budget_is_that_of_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    settings = {"run.duration_s": 0.0016, "controller.law": "force_feedback"}
    words = [f"--set={key}={value}" for key, value in settings.items()]
    words += ["--quick", "--only=latency_us", "--no-real-plant"]
    succeed("budget", "aluminium-3mm", *words, "--json", "a.json")
    request = hertzloop.BudgetRequest(quick=True, only=["latency_us"], with_real=False, workers=1)
    found = hertzloop.budget(hertzloop.load("aluminium-3mm", settings), request).as_data()
    assert found["limits"] == json_in("a.json")["limits"]
    assert found["limits"]["latency_us"]["value"] == 9.0


def test_a_margin_holds_the_loop_in_flight_and_its_jitter():
    feedback = {"controller.law": "velocity_feedback", "controller.kappa": 0.05}
    found = hertzloop.margin(hertzloop.load("aluminium-3mm", feedback))
    assert found.flight.stable
    assert found.jitter is not None
    assert "binding_mode" in found.as_data()


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda s: hertzloop.modes(hertzloop.vary(s, {"run.plate_model": "infinite"})), "no modes"),
        (lambda s: hertzloop.sweep(s, {"controller.kappa": 3}), "must be a list of values"),
        (lambda s: hertzloop.tune(s, laws="predicted"), r"laws = 'predicted': must be a list"),
    ],
)
def test_mistakes_end_in_one_sentence(scene, call, sentence):
    with pytest.raises(ValueError, match=sentence):
        call(scene)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            {"transport": "bus"},
            'bus.: is not possible. Possible values: "zenoh", "inprocess", "compiled"',
        ),
        ({"recording": "a.txt"}, "recording = 'a.txt': must end in .mcap. Change the name"),
        ({"recording": "none/a.mcap"}, "the folder none does not exist. Create it"),
        (
            {"max_exchange_steps": 0},
            "Possible values: whole number, at least 1",
        ),
    ],
)
def test_an_impossible_option_has_its_own_error(scene, options, sentence):
    with pytest.raises(hertzloop.OptionError, match=sentence):
        hertzloop.run(scene, **options)


def test_an_existing_recording_is_refused_before_the_run(scene, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"old")
    with pytest.raises(hertzloop.OptionError, match="exists"):
        hertzloop.run(scene, path)
    assert path.read_bytes() == b"old"


@pytest.mark.full
def test_a_script_without_a_guarded_main_may_sweep_on_all_cores(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import hertzloop\n"
        "scene = hertzloop.load('aluminium-3mm', {'run.duration_s': 0.0015})\n"
        "request = hertzloop.SweepRequest({'controller.latency_us': range(40)}, workers=2)\n"
        "table = hertzloop.sweep(scene, request)\n"
        "print(table.sizes['case'], sum(table.status.values != ''))\n"
    )
    assert python(script).stdout == "40 0\n"


@pytest.mark.full
def test_the_notebook_runs(tmp_path):
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(EXAMPLES / "impact.ipynb", as_version=4)
    NotebookClient(notebook, timeout=250, resources={"metadata": {"path": tmp_path}}).execute()
    printed = [
        output.text
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        if output.output_type == "stream"
    ]
    assert "plate energy -2.10 dB\n" in printed


def test_a_study_names_its_parameters(tmp_path):
    with pytest.raises(hertzloop.DesignError, match=r"^over run\.seed=0:9 has no step"):
        hertzloop.sweep("aluminium-3mm", {"run.seed": "0:9"})
    with pytest.raises(hertzloop.SceneError, match=r"^uncertain = .*none\.toml: cannot be read"):
        hertzloop.budget("aluminium-3mm", uncertain=tmp_path / "none.toml")
    with pytest.raises(ValueError, match=r"^minimise = 'x': unknown metric"):
        hertzloop.tune("aluminium-3mm", minimise=["x"])
