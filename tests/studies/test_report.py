"""The page of a run: whole by itself, and without an error in a browser."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from hertzloop.commands.cli import app
from hertzloop.loop.inprocess import record_in_process
from hertzloop.scenes.scene import load

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
SHORT = ["run.duration_s=0.003", "run.accuracy=0.05", "plate.size_m=[0.2, 0.16]",
         "plate.contact_point_m=[0.09, 0.07]"]  # fmt: skip
UNSTABLE = ["controller.law=velocity_feedback", "controller.kappa=0.4", "run.duration_s=0.009"]


def call(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "300"})


def page_of(folder: Path, scene: str, settings: list[str]) -> Path:
    record_in_process(load(scene, settings), folder / "a.mcap", compiled=True)
    result = call("report", folder / "a.mcap", "-o", folder)
    assert result.exit_code == 0, result.output
    return folder / "a.html"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return page_of(tmp_path_factory.mktemp("page"), "aluminium-20mm", SHORT)


def in_browser(page: Path) -> tuple[str, list[str]]:
    """The page as it is after loading, and what came on the console."""
    assert BROWSER is not None
    done = subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr",
         f"--user-data-dir={page.parent / 'profile'}", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def test_a_page_needs_nothing_from_elsewhere_and_is_small(page: Path) -> None:
    text = page.read_text()
    assert len(text) < 10e6
    loaded = re.findall(r"""(?:src|href)\s*=\s*["']([^"']{1,60})""", text)
    assert all(target.startswith(("data:", "#")) for target in loaded), loaded
    assert "@import" not in text
    for word in ("with control", "without", "contact time", "sound exposure level",
                 "slope_threshold, kappa 0.8", "plate.size_m", "hertzloop run"):  # fmt: skip
        assert word in text
    assert text.count("data:audio/wav;base64,") == 2
    assert text.count("<svg") == 3


@pytest.mark.skipif(BROWSER is None, reason="no Chromium here: apt install chromium")
def test_a_browser_draws_it_without_an_error(page: Path, tmp_path: Path) -> None:
    found, console = in_browser(page)
    assert console == []
    drawn = re.search(r'data-drawn-after-ms="(\d+)"', found)
    assert drawn, "the plate was not drawn"
    assert int(drawn[1]) < 5000
    assert re.search(r'id="words">[\d.]+ ms, actuator', found)
    broken = tmp_path / "broken.html"
    broken.write_text(page.read_text().replace("draw(0);", "drow(0);"))
    assert any("drow is not defined" in line for line in in_browser(broken)[1])


def test_a_run_that_explodes_says_so_and_one_without_contact_too(tmp_path: Path) -> None:
    text = page_of(tmp_path, "aluminium-20mm", UNSTABLE).read_text()
    assert '<p class="warning">Unstable from 7.547 ms on' in text
    assert "<th>change</th>" not in text
    quiet = tmp_path / "quiet"
    quiet.mkdir()
    text = page_of(quiet, "aluminium-3mm", ["run.duration_s=0.0005"]).read_text()
    assert "No contact in this run." in text


def test_a_page_is_not_replaced_unasked(page: Path) -> None:
    result = call("report", page.with_suffix(".mcap"), "-o", page.parent)
    assert result.exit_code == 2
    assert "exists" in result.output
