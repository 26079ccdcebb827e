"""Text tables drawn at random, read by `hertzloop fit`'s reader, and compared with their numbers.

Each table has other lines above, beside and below it, other separators, units, signs, gaps and
encodings. A reading is right, refused in a sentence, or wrong. A part of the tables can be read in
two ways, or has a unit that nobody knows; these must be refused.
"""

import argparse
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.reading import read_record

RESULTS = ("right", "refused", "wrong")
_TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "\u00b5s": 1e-6, "ns": 1e-9, "seconds": 1.0}
_FORCE_UNITS = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": 4.4482216152605, "Newton": 1.0}
_UNKNOWN = ("lb", "tons", "counts", "Nm", "bananas", "kg")
_GAPS = ("", "nan", "NaN", "---", "OVL", "1.#INF", "-1.#IND", "#N/A", "inf")
_PREAMBLE = (
    ("Record Length", "{i}"),
    ("Model", "TX {i}"),
    ("Sample Mode", "Real time"),
    ("Vertical Scale", "{f}"),
    ("Probe", "{i}"),
    ("Date", "2024-05-06"),
    ("Trigger", "{f}"),
    ("Firmware Version", "1.{i}"),
    ("Channels", "{i}"),
    ("Operator", "A. B."),
    ("Gating", "0 to 9"),
    ("Vertical Offset", "{f}"),
    ("Bandwidth", "20 MHz"),
    ("Serial", "SN{i}"),
    ("Temp", "21.5 C"),
)


@dataclass
class TextCase:
    """A table: its bytes, the keys given with it, the numbers in it, and the features that it has.

    `must_refuse`: a careful person could not read it in one way.
    """

    raw: bytes
    given: dict[str, Any]
    time_s: np.ndarray
    value: np.ndarray
    features: list[str] = field(default_factory=list)
    must_refuse: bool = False


@dataclass(frozen=True)
class Reading:
    """How a table was read: "right", "refused" or "wrong", and in which words."""

    seed: int
    result: str
    must_refuse: bool
    features: str
    words: str


class _Draw:
    """Draws one table."""

    def __init__(self, seed: int) -> None:
        self.g = np.random.default_rng([seed, 4242])
        self.features: list[str] = []
        self.must_refuse = False
        self.given: dict[str, Any] = {}

    def some(self, name: str, chance: float) -> bool:
        """Whether a feature is in, which is noted."""
        found = bool(self.g.random() < chance)
        if found:
            self.features.append(name)
        return found

    def one(self, *choices: Any) -> Any:
        """One of the choices."""
        return choices[int(self.g.integers(len(choices)))]

    def number(self, value: float, style: str) -> str:
        """A number in one of the ways in which programs write it."""
        return {
            "g": f"{value:.10g}",
            "e": f"{value:.9e}",
            "+e": f"{value:+.8E}",
            "r": repr(float(value)),
            "D": f"{value:.10E}".replace("E", "D"),
            "minus": f"{value:.10g}".replace("-", "\u2212"),
        }[style]

    def case(self) -> TextCase:
        """Draw the table."""
        self._style()
        self._times()
        self._values()
        self._other_columns()
        raw = self._encoded(self._ended(self._lines()))
        return TextCase(raw, self.given, self.true_s, self.value, self.features, self.must_refuse)

    def _style(self) -> None:
        """How numbers are written, and the spacing of the rows."""
        g = self.g
        self.rows = int(g.integers(12, 90))
        self.separator = self.one(",", ",", ";", "\t", " ", "|")
        self.comma = self.separator != "," and self.some("decimal commas", 0.35)
        self.quoted = self.separator in ",;" and self.some("quotes", 0.12)
        self.quoted_comma = (
            self.quoted and self.separator == "," and self.some("decimal commas in quotes", 0.4)
        )
        self.style = self.one(
            "g", "e", "+e", "r", *(("D",) if self.some("D exponents", 0.05) else ())
        )
        if self.some("long minus", 0.03):
            self.style = "minus"
        self.step = float(self.one(1e-7, 5e-7, 1e-6, 1.25e-6, 1e-5))
        self.zero = float(self.one(0.0, -0.5, -0.25)) * self.rows * self.step
        self.features.append(
            {",": "comma", ";": "semicolon", "\t": "tab", " ": "spaces", "|": "bar"}[self.separator]
        )

    def put(self, value: float) -> str:
        """A number as a cell."""
        text = self.number(value, self.style)
        if self.comma or self.quoted_comma:
            text = text.replace(".", ",")
        return f'"{text}"' if self.quoted else text

    def seen(self, text: str) -> float:
        """The number of a cell."""
        text = text.strip('"').replace("\u2212", "-").replace("D", "E")
        return float(text.replace(",", ".") if self.comma or self.quoted_comma else text)

    def _times(self) -> None:
        """Times: a column, dates, or a fact above."""
        self.how = self.one(*["column"] * 6, "dates", "of day", "interval", "rate", "start column")
        self.unit = self.one(*_TIME_UNITS) if self.how == "column" else "s"
        self.features.append(f"times: {self.how}")
        instants = self.zero + self.step * np.arange(self.rows)
        self.columns: list[tuple[str, str, list[str]]] = []
        self.true_s = instants
        if self.how == "column":
            texts = [self.put(round(t / _TIME_UNITS[self.unit], 9)) for t in instants]
            if self.unit in ("s", "seconds"):
                texts = [self.put(float(f"{t:.9e}")) for t in instants]
            self.true_s = _TIME_UNITS[self.unit] * np.array([self.seen(t) for t in texts])
            self.columns.append(
                (self.one("Time", "time", "TIME", "t", "X", "Elapsed Time"), self.unit, texts)
            )
        elif self.how in ("dates", "of day"):
            of_day = 45_000.25 + self.step * np.arange(self.rows)
            texts = []
            order = self.one("{y}-{m}-{d}", "{d}.{m}.{y}", "{m}/{d}/{y}")
            for t in of_day:
                h, m = int(t // 3600), int(t // 60) % 60
                clock = f"{h:02d}:{m:02d}:{t % 60:012.9f}"
                date = order.format(y=2024, m="05", d="06") + self.one(" ")
                texts.append(clock if self.how == "of day" else date + clock)
            if self.separator == " " and self.how == "dates":
                texts = [t.replace(" ", "T") for t in texts]
            self.true_s = np.array([round(t, 9) for t in of_day])
            self.columns.append(
                (self.one("Time", "Timestamp", "Date Time".replace(" ", "")), "", texts)
            )
        elif self.how == "start column":
            self.columns.append(("X", "Sequence", [str(i) for i in range(self.rows)]))

    def _values(self) -> None:
        """Values, with gaps."""
        g = self.g
        peak = float(self.one(0.4, 12.0, 88.0, 250.0))
        shape = peak * np.exp(-(((np.arange(self.rows) - self.rows / 2) / (self.rows / 8)) ** 2))
        force = shape + 0.01 * peak * g.normal(size=self.rows)
        sensitive = self.some("volts", 0.25)
        f_unit = "V" if sensitive else self.one(*_FORCE_UNITS)
        factor = 0.01 if sensitive else 1.0 / _FORCE_UNITS[f_unit]
        texts = [self.put(float(f"{v * factor:.7g}")) for v in force]
        self.value = np.array([self.seen(t) for t in texts]) / (0.01 if sensitive else 1.0)
        self.value = self.value * (1.0 if sensitive else _FORCE_UNITS[f_unit])
        if self.some("gaps", 0.3):
            for i in g.choice(self.rows, size=int(g.integers(1, 4)), replace=False):
                gap = self.one(*(w for w in _GAPS if w or self.separator != " "))
                texts[i] = gap.replace(".", ",") if self.comma else gap
                self.value[i] = np.nan
        self.name = self.one(
            "Force", "contact_force", "CH1", "Channel A", "Kraft", "Excitation (Trigger)"
        )
        self.names_units = self.one("bracket", "bracket", "row", "row", "slash", "none")
        if self.separator == " ":
            self.name = self.one("force", "CH1")
            self.names_units = self.one("underscore", "row", "none")
        wrong = self.some("unknown unit", 0.06)
        size = 1.0 if sensitive else _FORCE_UNITS[f_unit]
        if wrong:
            f_unit, self.must_refuse = self.one(*_UNKNOWN), True
        if wrong and self.names_units == "underscore":  # any other word may be part of the name
            f_unit = self.one("lb", "counts", "kg")
        if self.name == "Excitation (Trigger)" and self.names_units != "row":
            self.name = "Excitation"
        if self.names_units == "none":
            self.value = self.value / size  # without a unit, SI units count
            self.must_refuse = False
            if self.how == "column" and self.unit not in ("s", "seconds"):
                self.given["time_unit"] = {"\u00b5s": "us"}.get(self.unit, self.unit)
        if sensitive:
            self.given["sensitivity"] = 0.01
            if wrong and self.names_units != "none":
                self.must_refuse = False
        self.columns.append((self.name, f_unit, texts))
        self.given["quantity"] = "contact_force"

    def _other_columns(self) -> None:
        """Columns that are not the record, and whether there is a heading."""
        g = self.g
        if self.some("second channel", 0.25):
            other = [self.put(float(f"{v:.6g}")) for v in g.normal(size=self.rows)]
            self.columns.append(("CH2" if self.name != "CH2" else "CH3", "V", other))
            self.given["column"] = self.name
        if self.separator != " " and self.some("column of text", 0.08):
            self.columns.append(
                ("Status", "", [self.one("OK", "OK", "valid") for _ in range(self.rows)])
            )
            self.given.setdefault("column", self.name)
        if self.some("sample numbers", 0.1) and self.how != "start column":
            self.columns.insert(
                0,
                (
                    "Index" if self.separator == " " else self.one("Index", "Sample", ""),
                    "",
                    [str(i) for i in range(self.rows)],
                ),
            )
        self.headless = (
            self.names_units == "none" and self.separator != " " and self.some("no heading", 0.4)
        )
        if self.headless:
            place = next(i for i, c in enumerate(self.columns) if c[0] == self.name)
            if len(self.columns) > 2 or "column" in self.given:
                self.given["column"] = place + 1
            if self.how == "start column" or self.columns[0][2][0] == "0" == self.columns[0][2][0]:
                self.headless = self.columns[0][2][:2] != ["0", "1"]
        if not self.headless and self.separator != " " and self.some("tables side by side", 0.08):
            place = next(i for i, c in enumerate(self.columns) if c[0] == self.name)
            self.given["column"] = place + 1
            short = self.rows - int(g.integers(0, 6))
            for head, beside in (
                ("Time", 3e-7 * np.arange(self.rows)),
                (self.name, g.normal(size=self.rows)),
            ):
                cells = [self.put(float(f"{v:.8g}")) for v in beside[:short]] + [""] * (
                    self.rows - short
                )
                self.columns.append((head, "s" if head == "Time" else "N", cells))

    def _lines(self) -> list[str]:
        """All lines of the file."""
        lines = [self.separator.join(c[2][i] for c in self.columns) for i in range(self.rows)]
        if (
            self.headless
            and self.separator in ",;\t"
            and self.rows > 40
            and self.some("facts beside", 0.5)
        ):
            facts = [f"Model{self.separator}TX 1", f"Vertical Scale{self.separator}0.2"]
            facts += [self.separator] * (self.rows - 2)
            lines = [fact + self.separator + line for fact, line in zip(facts, lines, strict=True)]
            if "column" in self.given:
                self.given["column"] += 2
        if self.separator in ",;" and self.some("separators at the ends", 0.1):
            lines = [line + self.separator for line in lines]
        pad = " " if self.separator in ",;" and self.some("spaces beside separators", 0.15) else ""
        if pad and not self.quoted:
            lines = [line.replace(self.separator, self.separator + "  ") for line in lines]
        above = self._above()
        lines = self._spoilt(lines)
        if self.some("comments in the table", 0.05):
            lines.insert(len(lines) // 2, "# a remark, 1 of 2")
        if self.some("lines below", 0.12):
            lines += self.one(["END"], ["", "End of data"], ["# done"], ["*** end ***", ""])
        return above + lines

    def _above(self) -> list[str]:
        """Lines above the table: facts, names, units."""
        g, found = self.g, []
        sep = self.separator if self.separator != " " else "\t"
        if self.separator in ";,|" and self.some("sep line", 0.05):
            found.append(f"sep={self.separator}")
        kind = self.one("none", "none", "facts", "facts", "comments", "text", "long")
        self.features.append(f"above: {kind}")
        count = {"none": 0, "long": int(g.integers(40, 400))}.get(kind, int(g.integers(1, 25)))
        body = []
        for _ in range(count):
            key, form = self.one(*_PREAMBLE)
            words = form.format(i=int(g.integers(1, 5000)), f=f"{g.random():.4f}")
            line = f"{key}: {words}" if kind in ("comments", "text") else f"{key}{sep}{words}"
            body.append(("# " if kind == "comments" else "") + line)
        fact = {
            "interval": self.one(
                f"Sample Interval{sep}{self.step!r}",
                f"Delta_X{sep}{self.step!r}",
                f"Sampling Interval{sep}{1e6 * self.step:.9g} us",
            ),
            "rate": self.one(
                f"Sample Rate{sep}{1 / self.step:.9g}",
                f"Sample Rate{sep}{1e-6 / self.step:.9g} MHz",
            ),
        }.get(self.how)
        if fact:
            body.insert(int(g.integers(len(body) + 1)), fact)
        found += body
        if count and self.some("empty line above", 0.3):
            found.append("")
        if self.headless:
            return found
        names, units = [], []
        for name, unit, _ in self.columns:
            stated = unit if self.names_units != "none" else ""
            if unit == "Sequence":
                stated = ""
            names.append(
                {
                    "bracket": f"{name} {self.one('[{}]', '({})').format(stated)}"
                    if stated
                    else name,
                    "slash": f"{name} / {stated}" if stated else name,
                    "underscore": f"{name}_{stated}" if stated else name,
                }.get(self.names_units, name)
            )
            units.append(unit and self.one(unit, f"({unit})"))
            if self.names_units == "none" and unit != "Sequence":
                units[-1] = ""
        if self.how == "start column":
            names += ["Start", "Increment"]
            units += [repr(self.zero), repr(self.step)]
        row = [u or ("-" if self.separator == " " else "") for u in units]
        if self.separator == " ":
            names = [n.replace(" ", "_") or "Index" for n in names]
        commented = (
            kind != "comments" and self.names_units != "row" and self.some("# heading", 0.05)
        )
        found.append(("# " if commented else "") + self.separator.join(names))
        if self.names_units == "row" or self.how == "start column":
            found.append(self.separator.join(row))
        if self.some("empty line below the heading", 0.08):
            found.append("")
        return found

    def _spoilt(self, lines: list[str]) -> list[str]:
        """The table with something that cannot be read in one way, in a part of the cases."""
        if self.g.random() > 0.12 or "facts beside" in self.features:
            return lines
        kind = self.one("thousands", "unit in cell", "two signs", "two tables", "cut row", "words")
        at = len(lines) // 2
        place = next(i for i, c in enumerate(self.columns) if c[0] == self.name)
        if self.separator == " " or '"' in lines[at]:
            return lines
        cells = lines[at].split(self.separator)
        if kind == "thousands":
            if self.separator == ",":
                return lines
            cells[place] = "1.234,5" if self.comma else "1,234.5"
        elif kind == "unit in cell":
            cells[place] = "3 N"
        elif kind == "two signs":
            cells[place] = "0.5" if self.comma else "0,5"
            if self.separator == "," or not any(
                ("," if self.comma else ".") in c for c in self.columns[place][2]
            ):
                return lines
        elif kind == "two tables":
            self.features.append("spoilt: two tables")
            self.must_refuse = True
            return [*lines, "Time" + self.separator + "Force", *lines]
        elif kind == "cut row":
            cells += ["0.25", "7"]
        else:
            cells[place] = "12abc"
        self.features.append(f"spoilt: {kind}")
        self.must_refuse = True
        return [*lines[:at], self.separator.join(cells), *lines[at + 1 :]]

    def _ended(self, lines: list[str]) -> str:
        end = self.one("\n", "\n", "\r\n", "\r\n", "\r", "\r\r\n")
        self.features.append(f"line ends: {end!r}")
        return end.join(lines) + (end if self.some("last line ended", 0.7) else "")

    def _encoded(self, text: str) -> bytes:
        kind = self.one("utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252")
        if kind == "cp1252" and "\u2212" in text:
            kind = "utf-8"
        self.features.append(kind)
        return text.encode(kind)


def draw(seed: int) -> TextCase:
    """Draw a table by its number."""
    return _Draw(seed).case()


def judged(case: TextCase, seed: int, folder: Path) -> Reading:
    """Read a table and compare it with its numbers."""
    path = folder / "drawn.csv"
    path.write_bytes(case.raw)
    features = ", ".join(case.features)
    try:
        record = read_record(path, case.given)
    except RecordError as error:
        words = str(error)
        good = len(words) > 20 and words.endswith(".")
        return Reading(seed, "refused" if good else "wrong", case.must_refuse, features, words)
    except Exception as error:  # anything else is a defect
        return Reading(
            seed, "wrong", case.must_refuse, features, f"{type(error).__name__}: {error}"
        )
    if case.must_refuse:
        return Reading(seed, "wrong", True, features, f"accepted: {record.source}")
    known, true = np.isfinite(record.value), np.isfinite(case.value)
    same = np.count_nonzero(known) == np.count_nonzero(true) and (
        np.allclose(record.value[known], case.value[true], rtol=1e-12, atol=0.0)
        and np.allclose(
            np.diff(record.time_s[known]), np.diff(case.time_s[true]), rtol=1e-4, atol=3e-12
        )
    )
    return Reading(seed, "right" if same else "wrong", False, features, record.source)


def main() -> int:
    """Read tables that are drawn at random; print counts, and those that are read wrongly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", type=int, default=10_000, help="draw this many tables")
    parser.add_argument("--first", type=int, default=0, help="number of the first table")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        seeds = range(asked.first, asked.first + asked.tables)
        found = [judged(draw(seed), seed, Path(folder)) for seed in seeds]
    for one in found:
        if one.result == "wrong":
            print(f"wrong: table {one.seed} ({one.features}): {one.words}")
    counts = Counter((one.must_refuse, one.result) for one in found)
    for refuse, said in ((False, "readable"), (True, "not readable in one way")):
        numbers = ", ".join(f"{result} {counts[refuse, result]:,}" for result in RESULTS)
        print(f"{said}: {numbers}")
    return int(any(one.result == "wrong" for one in found))


if __name__ == "__main__":
    sys.exit(main())
