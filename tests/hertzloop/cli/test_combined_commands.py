"""Commands with each feature of sphere, structure and sensor give the same numbers."""

import csv
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.structures.mode_file import ModeTable, write_modes
from hertzloop.plant.time_series import F_C
from hertzloop.scene.build import build_plant
from tests.commands import as_options, succeed
from tests.hertzloop.own_laws import write_law
from tests.hertzloop.scenes import aluminium_3mm, json_in

FEATURES = {
    "mass and speed": "sphere.mass_kg=0.002 sphere.speed_m_s=0.7",
    "sensor elsewhere": "sensors.point_m=[0.31,0.22] sensors.quantity=v_p "
    "controller.law=velocity_feedback",
    "modes from a file": "plate.modes=MODES sensors.quantity=v_p controller.law=velocity_feedback",
}
# Of a short span a sweep takes the infinite plate, which is right within the accuracy only.
SHORT = (
    "run.duration_s=0.003",
    "run.accuracy=0.01",
    "run.lead_in_s=0.001",
    "run.plate_model=modal",
)
LATENCIES = "0,4"


@pytest.fixture(scope="module")
def modes(tmp_path_factory):
    """A file of modes of three points."""
    table = build_plant(aluminium_3mm()).modes
    rng, count = np.random.default_rng(2), len(table.omega)
    path = tmp_path_factory.mktemp("modes") / "modes.csv"
    own = ModeTable(
        np.asarray(table.omega),
        np.full(count, 1e-3),
        np.full(count, table.scale_per_kg),
        np.asarray(table.contact),
        rng.normal(0.0, 1.0, count),
        1e-8,
        shape_sensor=rng.normal(0.0, 1.0, count),
    )
    path.write_bytes(write_modes(".csv", own))
    return path


def settings_of(name: str, modes: Path) -> list[str]:
    return [*SHORT, *FEATURES[name].replace("MODES", str(modes)).split()]


@pytest.mark.full
@pytest.mark.parametrize("name", FEATURES)
def test_run_sweep_report_and_export_have_the_same_numbers(name, modes, tmp_path):
    settings = settings_of(name, modes)
    scene = ["aluminium-3mm", *as_options(settings)]
    file, sweep, metrics = tmp_path / "a.mcap", tmp_path / "s.csv", tmp_path / "a.json"
    over = ["--over", f"controller.latency_us={LATENCIES}", "--workers", "1"]
    text = "".join(
        succeed(*words)
        for words in (
            ["run", *scene, "-o", file, "--json", metrics],
            ["sweep", *scene, *over, "-o", sweep],
            ["inspect", file],
            ["report", file, "-o", tmp_path / "r"],
            ["export", file, "-o", tmp_path / "a.parquet"],
            ["replay", file, "--save", tmp_path / "a.rrd"],
        )
    )
    text += next((tmp_path / "r").glob("*.html")).read_text().partition("The law ")[0]
    loop = simulate(aluminium_3mm(*settings))
    assert abs(loop.balance.energy_residual) < 1e-10
    assert abs(loop.balance.momentum_residual) < 1e-10
    with sweep.open() as lines:
        first = next(csv.DictReader(lines))
    peak_n = json_in(metrics)["first_impact"]["peak_force_n"]
    assert float(first["peak_force_n"]) == pytest.approx(peak_n, rel=1e-9)
    assert peak_n == pytest.approx(np.max(loop.truth[F_C]), rel=5e-3)
    force = parquet.read_table(tmp_path / "a.parquet")["f_c_n"].to_numpy()
    assert force.tobytes() == loop.truth[F_C, : len(force)].tobytes()


@pytest.mark.full
@pytest.mark.parametrize("name", ["mass and speed", "sensor elsewhere", "modes from a file"])
def test_it_runs_in_each_transport(name, modes, tmp_path):
    settings = settings_of(name, modes)
    if name == "mass and speed":  # a law of one's own senses the gap
        settings.append(f"controller.law={write_law(tmp_path)}")
    files = [tmp_path / f"{kind}.mcap" for kind in ("zenoh", "compiled")]
    for file in files:
        run = ["run", "aluminium-3mm", *as_options(settings), "--transport", file.stem]
        succeed(*run, "-o", file)
    assert succeed("compare", *files).startswith("the same: ")
