"""Commands of the pages run from an empty folder with the installed wheel."""

import os
import re
import shlex
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.test_wheel import installed, wheels  # noqa: F401  (fixtures)

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "docs" / "examples"
PROGRAMS = ("hertzloop ", "python ", "python3 ", "cc ", "cd ", "mkdir ", "pip ",
            "pytest", "git ", "cmake ", "nanopb_generator ", "./")  # fmt: skip
# Blocks of files that a page asks the reader to save; their first line is a comment with the name.
FILE = re.compile(r"```py\n# (\w+\.py)\n(.*?)```", re.DOTALL)
# What is not run, by how the command begins, and why.
LEFT_OUT = {
    "python3 -m venv": "installs",
    "pip install": "installs",
    "git clone": "fetches",
    "hertzloop scene keys --markdown >": "writes a page of the clone",
    "python -c 'from tests import metric_page": "as before",
    "python -m tests.python_page": "as before",
    "cmake ": "needs the sources of zenoh-pico",
    "nanopb_generator ": "needs nanopb",
    "cc -O2 -std=gnu11 -ffp-contract=off -DZENOH_LINUX": "as before",
    "hertzloop law test --max-exchange-steps 200 --controller './pico": "as before",
    "hertzloop run aluminium-3mm --max-exchange-steps 200 --controller './pico": "as before",
    "./pico_controller ": "as before",
    "python modes.py": "needs sdypy-EMA: tests/test_measured_structures_page.py",
    "hertzloop run structure.toml": "as before",
    "hertzloop budget structure.toml": "as before",
    "hertzloop run --set controller.law=their.fmu": "the reader's file: test_fmu.py",
    "hertzloop fit rig.toml controlled.csv": "the reader's file: test_controlled_records.py",
    "hertzloop fit --check drop.csv": "the reader's file: tests/fitting/fit/test_fit.py",
    "hertzloop fit bench.toml drop.csv": "the reader's file; the tutorial of fits has a fit",
}
# What is made shorter: other tests run the whole.
SHORTER = {
    "--cases 512": "--cases 16",
    "--cases 50": "--cases 4",
    "hertzloop tune": "hertzloop tune --generations 2 --population 8",
    "--law force_feedback\n": "--law force_feedback --quick\n",
    "--goal 'rebound_percent < 300'\n": "--goal 'rebound_percent < 300' --quick\n",
    "--trace paced.mcap ": "--trace paced.mcap --quick ",
    "pytest requirements.toml": "python -m pytest requirements.toml",
    "10.0.0.1": "127.0.0.1",
    "10.0.0.2": "127.0.0.1",
    "10.0.0.3": "127.0.0.1",
}
# What a page says that the reader has.
HAS = {
    "docs/how-to/budget.md": "hertzloop law new mine.py --with-check",
    "docs/how-to/recordings.md": "hertzloop run aluminium-3mm --out A.mcap && "
    "hertzloop run aluminium-3mm --set controller.latency_us=1 --out B.mcap",
    "docs/how-to/own-loop.md": f"cp {EXAMPLES}/the_loop.py {EXAMPLES}/gym_env.py .",
    "docs/how-to/latency-trace.md": f"cp {EXAMPLES}/latency/* .",
    "docs/reference/wire.md": f"cp {EXAMPLES}/own_controller.py my_controller.py",
    "docs/tutorials/fit.md": f"cp {EXAMPLES}/bench* .",
}
BEFORE = {
    "hertzloop node recorder --out mine.mcap --zenoh-config": "cp lab/*.json5 . && rm mine.mcap",
    "hertzloop node recorder --out mine.mcap --listen": "rm mine.mcap",
}
CODES = {
    "hertzloop compare A.mcap B.mcap --metrics": 0,
    "hertzloop compare A.mcap B.mcap": 1,
    "hertzloop law replay shipped.mcap --law mine.py": 1,
    "hertzloop budget --check requirements.toml  # green-check.md": 1,
    "hertzloop fit bench.toml --check --expect contact_force:80us:0.4%": 2,
}


def limited(text: str, folder: Path) -> None:
    """Replace the last line of `command` by that of the page."""
    [line] = re.findall(r"^    return min\(.*\)$", text, re.M)
    law = folder / "mine.py"
    changed, count = re.subn(r"^    return p\.factor .*$", line, law.read_text(), flags=re.M)
    assert count == 1
    law.write_text(changed)


def a_third(text: str, folder: Path) -> None:
    """Add the row of the page to the requirements."""
    [row] = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    with (folder / "requirements.toml").open("a") as file:
        file.write("\n" + row)


def five(text: str, folder: Path) -> None:
    """Require 5 us instead of 10."""
    path = folder / "requirements.toml"
    assert '"controller.latency_us" = 10 }' in path.read_text()
    path.write_text(path.read_text().replace('latency_us" = 10 }', 'latency_us" = 5 }'))


# What the reader of a page edits before a command.
EDITS: dict[tuple[str, str], Callable[[str, Path], None]] = {
    ("own-law.md", "hertzloop run --set controller.law=mine.py --out limited.mcap"): limited,
    ("green-check.md", "hertzloop budget --check requirements.toml"): a_third,
    ("green-check.md", "python -m pytest"): five,
}


def blocks(page: Path) -> list[list[str]]:
    """Command lines of a page's plain blocks, assignments of the shell included."""
    found = []
    for kind, text in re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(), re.DOTALL | re.M):
        if kind:
            continue
        lines, open_line = [], ""
        for line in text.splitlines():
            if not open_line and not line.startswith(PROGRAMS) and not re.match(r"[A-Z]=", line):
                continue
            open_line += line
            try:
                shlex.split(open_line, comments=True)
            except ValueError:  # a quotation goes on in the next line
                open_line += "\n"
                continue
            lines.append(open_line)
            open_line = ""
        if lines:
            found.append(lines)
    return found


PAGES = [
    page.relative_to(ROOT)
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if blocks(page)
]


def told(line: str) -> str:
    """The command as it is run here."""
    line += "\n"
    for long, short in SHORTER.items():
        line = line.replace(long, short)
    line = line.rstrip("\n")
    if line.startswith("hertzloop replay") and "--save" not in line:
        line += " --save page.rrd --overwrite"  # the window is tested elsewhere
    return line


@pytest.mark.full
@pytest.mark.timeout(3600)  # the first page compiles; a busy machine takes its time
@pytest.mark.parametrize("page", PAGES, ids=str)
def test_the_commands_of_a_page_run_with_the_wheel(
    page: Path,
    installed: str,  # noqa: F811
    tmp_path: Path,
) -> None:
    place = {
        **os.environ,
        "PATH": f"{Path(installed).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": "",
        "HOME": str(tmp_path),
        "NUMBA_CACHE_DIR": str(Path(installed).parents[2] / "cache"),  # of all pages
    }

    def started(line: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            ["bash", "-c", line],
            cwd=tmp_path,
            env=place,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    def ended(line: str, process: subprocess.Popen[str]) -> None:
        began = time.monotonic()
        said, erred = process.communicate(timeout=850)
        named = f"{line}  # {page.name}"
        code = next((code for words, code in CODES.items() if named.startswith(words)), 0)
        assert process.returncode == code, (line, said[-500:], erred[-1500:])
        if line.startswith("python ") and line.endswith(".py"):  # the page shows what it prints
            assert said in (ROOT / page).read_text(), line
        print(f"{time.monotonic() - began:6.1f} s  {line.splitlines()[0][:100]}")

    for name, text in FILE.findall((ROOT / page).read_text()):
        (tmp_path / name).write_text(text)
    if str(page) in HAS:
        ended(HAS[str(page)], started(HAS[str(page)]))
    for lines in blocks(ROOT / page):
        given = "".join(f"{line}; " for line in lines if re.match(r"[A-Z]=", line))
        running = []
        for line in lines:
            if line + "; " in given or line.startswith(tuple(LEFT_OUT)):
                continue
            if edit := EDITS.get((page.name, line)):
                edit((ROOT / page).read_text(), tmp_path)
            for words, first in BEFORE.items():
                if line.startswith(words):
                    ended(first, started(first))
            process = started(given + told(line))
            if re.match(r"hertzloop node (plant|controller|recorder)", line):
                running.append((line, process))  # each in a terminal of its own
            else:
                ended(line, process)
        for line, process in running:
            ended(line, process)


def test_what_is_left_out_or_made_shorter_is_there():
    lines = [
        f"{line}  # {page.name}"
        for page in PAGES
        for block in blocks(ROOT / page)
        for line in block
    ]
    for words in (*LEFT_OUT, *BEFORE, *CODES, *(f"{b}  # {a}" for a, b in EDITS)):
        assert any(line.startswith(words) for line in lines), words
    lines = [line.rpartition("  # ")[0] for line in lines]
    for words in SHORTER:
        assert any(words in line + "\n" for line in lines), words
