"""Units that other programs write beside numbers: their dimension and their size."""

import re
from collections.abc import Collection
from typing import NamedTuple

_SIZES = {
    "": 1.0,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
    "da": 10.0,
    "d": 0.1,
    "c": 1e-2,
    "m": 1e-3,
    "u": 1e-6,
    "n": 1e-9,
    "p": 1e-12,
}
# SI unit, size, and the prefixes in use. A meganewton and a kilo-g stand in no record: they are
# a millinewton and a kilogram that were written another way.
_BASES = {
    "s": ("s", 1.0, " m u n p"),
    "min": ("s", 60.0, " "),
    "h": ("s", 3600.0, " "),
    "N": ("N", 1.0, " k c m u n da"),
    "lbf": ("N", 4.4482216152605, " "),
    "kgf": ("N", 9.80665, " "),
    "kp": ("N", 9.80665, " "),
    "dyn": ("N", 1e-5, " "),
    "pdl": ("N", 0.138254954376, " "),
    "m": ("m", 1.0, " c d m u n p"),
    "in": ("m", 0.0254, " "),
    "ft": ("m", 0.3048, " "),
    "mil": ("m", 2.54e-5, " "),
    "g": ("m/s^2", 9.80665, " m u"),
    "V": ("V", 1.0, " k m u n"),
    "A": ("A", 1.0, " k m u n"),
    "C": ("C", 1.0, " m u n p"),
    "Pa": ("Pa", 1.0, " k M G m"),
    "Hz": ("Hz", 1.0, " k M G m"),
    "S/s": ("Hz", 1.0, " k M G"),
}
_WORDS = {
    "newton": "N",
    "second": "s",
    "sec": "s",
    "metre": "m",
    "meter": "m",
    "volt": "V",
    "ampere": "A",
    "amp": "A",
    "coulomb": "C",
    "pascal": "Pa",
    "hertz": "Hz",
    "inch": "in",
    "foot": "ft",
    "minute": "min",
    "hour": "h",
}
_LONG = {
    "kilo": "k",
    "mega": "M",
    "centi": "c",
    "milli": "m",
    "micro": "u",
    "nano": "n",
    "pico": "p",
}
_OTHERS = {
    "gn": "g",
    "g_n": "g",
    "G": "g",
    "lb_f": "lbf",
    "micron": "um",
    "microns": "um",
    "inches": "in",
    "feet": "ft",
    "Sa/s": "S/s",
    "sps": "S/s",
    "samples/s": "S/s",
    "samples/second": "S/s",
    "m*s-2": "m/s^2",
    "m*s-1": "m/s",
    "S": "s",
    "MS": "ms",
    "US": "us",
    "NS": "ns",
    "mS": "ms",
    "uS": "us",
    "nS": "ns",
    "KN": "kN",
    "hr": "h",
}
# Units that may follow any name after an underscore; "channel_A" and "v_s" end in no unit.
UNITS_AT_ENDS = (
    "N",
    "kN",
    "mN",
    "lbf",
    "V",
    "mV",
    "uV",
    "g",
    "mm",
    "um",
    "nm",
    "m/s",
    "mm/s",
    "MN",
    "lb",
    "lbs",
    "kg",
    "Nm",
    "tons",
    "psi",
    "bar",
    "counts",
    "bits",  # not known as units
)


class StatedUnit(NamedTuple):
    """The SI unit of a quantity, the size of a stated unit in it, and the symbol of that."""

    si: str
    size: float
    symbol: str


def _all() -> dict[str, StatedUnit]:
    exact, long = {}, {}
    for base, (si, size, prefixes) in _BASES.items():
        for prefix in ["", *prefixes.split()]:
            exact[prefix + base] = StatedUnit(si, _SIZES[prefix] * size, prefix + base)
    for word, base in _WORDS.items():
        for name, prefix in {"": "", **_LONG, **{p: p for p in "munkM"}}.items():
            if prefix + base in exact and (len(name) != 1 or base == "s"):
                long[name + word] = long[name + word + "s"] = exact[prefix + base]
    for unit in ("m", "cm", "mm", "um", "nm", "in", "ft"):
        size = exact[unit].size
        for time in ("/s", "/s^2"):
            exact[unit + time] = StatedUnit("m" + time, size, unit + time)
    for prefix in ("k", "M", "G", ""):
        exact[prefix + "Sa/s"] = exact[prefix + "S/s"]
    exact |= {name: exact[of] for name, of in _OTHERS.items()}
    lower = {name.lower(): exact[name] for name in sorted(exact) if name.lower() not in exact}
    return long | {name: of for name, of in lower.items() if name not in long} | exact


_UNITS = _all()


def unit_of(text: str) -> StatedUnit | None:
    """Return the unit that a text such as "(us)", "kN" or "Volts" names; None if it names none."""
    said = text.strip().strip("'\"").strip()
    if said[:1] + said[-1:] in ("()", "[]", "{}", "<>"):
        said = said[1:-1].strip()
    said = re.sub("[\u00b5\u03bc]", "u", said).replace("\u00b2", "^2").replace("**", "^")
    said = re.sub(r"\s*([/*\u00b7\u22c5])\s*", r"\1", said).replace("\u00b7", "*").rstrip(".")
    said = re.sub(r"(?<=[a-z])[ \u22c5](?=s\^?-)", "*", said).replace("^-", "-")
    said = re.sub(r"/\(?s\^?2\)?$|/s/s$|/sec\^?2$", "/s^2", re.sub(r"\bsec$", "s", said))
    found = _UNITS.get(said)
    if found is None and len(said) > 2:
        found = _UNITS.get(said.lower())
    return found


def name_and_unit(heading: str, names: Collection[str]) -> tuple[str, str]:
    """Split a heading into the name and the unit that it states, "" if it states none.

    Args:
        heading: such as "Force [kN]", "Zeit / s" or "time_us".
        names: plain names that a unit may follow after an underscore.
    """
    text = heading.strip()
    found = re.fullmatch(r"(.*?)[\s_]*[(\[{<]([^()\[\]{}<>]*)[)\]}>]", text)
    if found and (not found[2][-1:].isdigit() or unit_of(found[2])):
        return found[1], found[2].strip()
    found = re.fullmatch(r"(.*?)\s*(\s/|\bin|,)\s+(\S+)", text)
    if found and (found[2] == " /" or unit_of(found[3])):
        return found[1], found[3]
    plain = plain_name(text)
    if plain in names:
        return text, ""
    if (found := re.fullmatch(r"(.+?)/(\S+)", text)) and unit_of(found[2]) and not unit_of(text):
        return found[1], found[2]
    for name in sorted(names, key=len, reverse=True):
        if plain.startswith(name + "_"):
            # The unit as it is written: FORCE_MN may be of mega- or of millinewtons.
            ending = re.sub(r"[\s_]+", "_", text)[len(name) + 1 :]
            for unit in (ending, re.sub(r"_s\^?(2?)$", r"/s^\1", ending).removesuffix("^")):
                if unit_of(unit):
                    return name, unit
    if (found := re.fullmatch(r"(.+)[ _](\S+)", text)) and found[2] in UNITS_AT_ENDS:
        return found[1], found[2]
    return text, ""


def plain_name(text: str) -> str:
    """Return a name in small letters, with an underscore for all other signs."""
    name = text.strip().lower().replace("^", "").replace("\u00b2", "2")
    return re.sub(r"[^a-z0-9]+", "_", re.sub("[\u00b5\u03bc]", "u", name)).strip("_")
