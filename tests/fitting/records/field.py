"""Files in the layouts of instruments and other tools, with the right answers.

Each file is a simulated drop, filter, latency or law that another program could have written. The
folder stands beside the repository; without it, the tests that need it are skipped. The program
prints the table of the evidence.

Run it with: python -m tests.fitting.records.field ../shared/field
"""

import json
import re
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from tests.commands import invoke

FOLDER = Path(__file__).resolve().parents[4] / "shared" / "field"
_PULSE = ("sphere.radius_m", "sphere.drop_height_m")


class Answer(NamedTuple):
    """What a file must give: words of the output, or of the refusal.

    `words`: hertzloop's arguments, {f} is the file; "" for a fit of radius and drop height.
    """

    says: str
    refused: bool = False
    words: str = ""


_TRUE = {
    "sphere.radius_m": 0.003,
    "sphere.drop_height_m": 0.05,
}
_FILTER = "margin oak-20mm --set controller.law=linear --set controller.filter_file={f}"
_MARGIN = r"latency limit: 2 steps \(2\.671 us\).*ends\): 3\.045"
_LATENCY = "run aluminium-3mm --transport compiled --set controller.latency_trace={f} -o {o}"
_LAW = "run aluminium-3mm --transport compiled --set run.duration_s=0.002 --set controller.law={f} -o {o}"  # noqa: E501

ANSWERS = {
    "no-pretrigger-0.001.csv": Answer("contact_force: column 2 'contact_force_n' in N"),
    "with-pretrigger-0.001.csv": Answer("contact_force: column 2 'contact_force_n' in N"),
    "one-hash-inf.csv": Answer(r"invalid value .1\.#INF.", True),
    "decimal-comma-integer-first.csv": Answer(r"give record\.decimal = ','", True),
    **dict.fromkeys(
        ("pico-us.csv", "row_kN.csv", "row_mm.csv", "sep-line.csv", "savetxt-header.csv",
         "trailing-comma.csv"),
        Answer(r"hertzloop\.Record\(", True),
    ),
    "filter-good.npz": Answer(_MARGIN, words=_FILTER),
    "filter-dtTrue.npz": Answer(_MARGIN, words=_FILTER),
    "filter-sos_ok.npz": Answer(r"ends\): 0\.1059", words=_FILTER),
    "filter-ct.npz": Answer("dt = 0 marks a continuous filter", True, _FILTER),
    "filter-fir31.npz": Answer(r"stable at .*limit: \d+ steps \(2127 us\)", words=_FILTER),
    "filter-dt20us.npz": Answer("designed for another sampling interval", True, _FILTER),
    "latency-right.csv": Answer(r"1\.5 dB", words=_LATENCY),
    "latency-ms.csv": Answer(r"1\.5 dB", words=_LATENCY),
    "latency-decimal-comma.csv": Answer(r"1\.5 dB", words=_LATENCY),
    "slow1ms.fmu": Answer("has a fixed step of 1000 us", True, _LAW),
    "units.fmu": Answer("Linear loop unstable", words=_LAW),
    "law.fmu": Answer("its key law is a key of the control loop", True, _LAW),
}  # fmt: skip


def asked(name: str, out: Path, folder: Path = FOLDER) -> tuple[int, str]:
    """Run the command of a file. Returns exit code and text."""
    words = ANSWERS[name].words or (
        "fit {d}/rig.toml {f} "
        + " ".join(f"--free {key}" for key in _PULSE)
        + " --out {t} --json {j} --overwrite"
    )
    (out / "o.json").unlink(missing_ok=True)
    places = {
        "f": folder / name,
        "d": folder,
        "o": out / "o.mcap",
        "t": out / "o.toml",
        "j": out / "o.json",
    }
    extra = ["--overwrite"] if "{o}" in words else []
    done = invoke([w.format(**places) for w in words.split()] + extra)
    text = " ".join(done.output.split())
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        text += f" {done.exception}"
    return done.exit_code, text


def right(name: str, code: int, text: str, out: Path) -> bool:
    """Whether a command said what it must."""
    answer = ANSWERS[name]
    if answer.refused:
        return re.search(answer.says, text) is not None and "written:" not in text
    if (out / "o.json").exists():
        found = json.loads((out / "o.json").read_text())
        known = all(
            one["low"] is None or one["low"] <= _TRUE[key] <= one["high"]
            for key, one in found["parameters"].items()
        )
        fits = found["model"] != "does not fit"
        return known and fits and bool(re.search(answer.says, text))
    return code == 0 and re.search(answer.says, text) is not None


def main() -> None:
    """Print a line for each file."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    counts = [0, 0]
    with tempfile.TemporaryDirectory() as place:
        for name, answer in ANSWERS.items():
            code, text = asked(name, Path(place), folder)
            good = right(name, code, text, Path(place))
            counts[good] += 1
            kind = "refused" if answer.refused else "read"
            print(f"| `{name}` | {kind} | {'right' if good else 'WRONG'} |")
            if not good:
                print(text[-600:])
    print(f"{counts[1]} of {sum(counts)} files give the right answer.")


if __name__ == "__main__":
    main()
