"""The page of a run: whole by itself, and without an error in a browser."""

import html
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.scene.setup import load
from tests.commands import as_options, refused, succeed
from tests.hertzloop.own_laws import write_law
from tests.hertzloop.scenes import json_in
from tests.recordings.rewriting import messages, write

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
SHORT = [
    "run.duration_s=0.003",
    "run.accuracy=0.05",
    "plate.size_m=[0.2, 0.16]",
    "plate.contact_point_m=[0.09, 0.07]",
]
UNSTABLE = ["controller.law=velocity_feedback", "controller.kappa=0.4", "run.duration_s=0.009"]


def page_of(folder: Path, scene: str, settings: list[str]) -> Path:
    record_in_process(load(scene, settings), folder / "a.mcap", compiled=True)
    succeed("report", folder / "a.mcap", "-o", folder)
    return folder / "a.html"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
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


def test_a_page_needs_nothing_from_elsewhere_and_is_small(page):
    text = page.read_text()
    assert len(text) < 10e6
    loaded = re.findall(r"""(?:src|href)\s*=\s*["']([^"']{1,60})""", text)
    assert all(target.startswith(("data:", "#")) for target in loaded), loaded
    assert "@import" not in text
    for word in (
        "with control",
        "without",
        "contact time",
        "First contact",
        "slope_threshold, kappa 0.8",
        "plate.size_m",
        "hertzloop run --repeat a.mcap --out a-again.mcap",
    ):
        assert word in text
    assert text.count("<svg") == 3
    assert "<script" not in text


@pytest.mark.full
@pytest.mark.skipif(BROWSER is None, reason="no Chromium here: apt install chromium")
def test_a_browser_draws_it_without_an_error(page):
    found, console = in_browser(page)
    assert console == []
    assert found.count("<svg") == 3


@pytest.mark.full
def test_a_run_that_explodes_says_so_and_one_without_contact_too(tmp_path):
    text = page_of(tmp_path, "aluminium-20mm", UNSTABLE).read_text()
    assert '<p class="warning">UNSTABLE: the actuator supplies' in text
    assert "<th>change</th>" not in text
    quiet = tmp_path / "quiet"
    quiet.mkdir()
    text = page_of(quiet, "aluminium-3mm", ["run.duration_s=0.0005"]).read_text()
    assert "No impact occurs within the run." in text
    assert text.count("<svg") == 1


def test_a_page_is_not_replaced_unasked(page):
    refused("exists", "report", page.with_suffix(".mcap"), "-o", page.parent)


TWICE = ["run.duration_s=0.15", "run.accuracy=0.02"]  # two impacts, the second one chaotic


@pytest.fixture(scope="module")
def bounces(tmp_path_factory):
    """A run that bounces, made as by a user, and what it said."""
    path = tmp_path_factory.mktemp("bounces") / "a.mcap"
    words = ("--transport", "compiled", "--out", path, "--json", path.with_suffix(".json"))
    succeed("run", "aluminium-3mm", *as_options(TWICE), *words)
    return path


def text_of(recording: Path) -> str:
    """What the page of a recording says."""
    folder = recording.parent / f"page-{recording.stem}"
    succeed("report", recording, "-o", folder)
    return html.unescape((folder / f"{recording.stem}.html").read_text())


@pytest.mark.full
def test_the_page_says_what_the_run_said(bounces):
    told = json_in(bounces.with_suffix(".json"))
    text = text_of(bounces)
    assert told["verdict"]
    assert "Later impacts are not predictable." in told["verdict"]
    neglected = [
        f["sentence"] for f in told["validity"] if f["state"] in ("left out", "out of range")
    ]
    assert neglected
    for sentence in (*told["verdict"], *neglected):
        assert sentence in text
    second = told["impacts"][1]
    assert f"{second['rebound_speed_m_s']:.4f}" not in text  # of which one digit is predictable
    assert (
        "only predictable digits are shown: the second impact magnifies the model's error" in text
    )
    assert "slope_threshold (law)" in text
    assert read(bounces).law_source in text


@pytest.mark.full
def test_what_another_program_controlled_is_not_said_to_repeat(bounces, tmp_path):
    def foreign() -> list:
        sent = messages(bounces)
        for item in sent:
            if item.stream == "end/controller":
                item.header.report.law, item.header.report.law_digest = "mine 1.0", ""
        return sent

    path = write(tmp_path / "other.mcap", bounces, foreign())
    text = text_of(path)
    assert "hertzloop run" not in text
    assert "holds no text of the law that ran, mine 1.0" in text
    assert read(path).law_source not in text
    assert "digits as recorded" in text
    assert "Digits as recorded" in succeed("inspect", path)
    assert "digits as recorded" in succeed("inspect", path, "--details")


@pytest.mark.full
def test_a_law_comes_out_of_its_recording(tmp_path, monkeypatch):
    """Law and scene of a recording run again, the law's file being lost."""
    monkeypatch.chdir(tmp_path)
    law = write_law(tmp_path)
    settings = [f"controller.law={law}", "run.duration_s=0.0016", "run.accuracy=0.05"]
    record_in_process(load("aluminium-3mm", settings), tmp_path / "a.mcap", compiled=True)
    source = law.read_bytes()
    law.unlink()
    Path("aluminium-3mm.toml").write_text(read(Path("a.mcap")).scene_toml)
    write = ("inspect", "a.mcap", "--law", str(law))
    succeed(*write)
    assert law.read_bytes() == source
    refused("", *write)  # it is there now
    again = ("run", "aluminium-3mm.toml", "--set", f"controller.law={law}", "--out", "b.mcap")
    succeed(*again, "--transport", "compiled")
    succeed("compare", "b.mcap", "a.mcap")
