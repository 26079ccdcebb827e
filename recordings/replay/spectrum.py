"""Spectra as a drawing with axes of its own: the viewer's plots know time only."""

import math
from dataclasses import dataclass

import numpy as np
import rerun as rr

BANDS_PER_OCTAVE = 12
_FADES = 0.25  # share of a run over which its end fades out
_FLOOR_DB = 100.0  # shown below the largest
_WIDTH, _HEIGHT = 100.0, 28.0
_GRID, _TEXT = (52, 58, 70), (170, 178, 190)
_DECADE_NAMES = {10: "10 Hz", 100: "100 Hz", 1000: "1 kHz", 10_000: "10 kHz", 100_000: "100 kHz"}


@dataclass(frozen=True)
class Spectrum:
    """Level in bands: `frequency_hz` (bands,), `level_db` (bands,) re 1 m/s rms."""

    label: str
    frequency_hz: np.ndarray
    level_db: np.ndarray


def spectrum(label: str, speed_m_s: np.ndarray, step_s: float) -> Spectrum | None:
    """RMS level of a plate velocity (steps,) in twelfth octaves; None where there is nothing."""
    speed = speed_m_s[: _good_length(len(speed_m_s))]
    if len(speed) < 64 or not np.isfinite(speed).all() or not speed.any():
        return None
    # A run starts at rest and may end in full swing: a cut would leak into all bands.
    fades = max(1, int(_FADES * len(speed)))
    speed = speed.copy()
    speed[-fades:] *= 0.5 + 0.5 * np.cos(np.pi * (np.arange(fades) + 1) / fades)
    power = 2.0 * np.abs(np.fft.rfft(speed) / len(speed)) ** 2
    frequency = np.fft.rfftfreq(len(speed), step_s)
    lowest, highest = 3.0 * frequency[1], 0.5 / step_s
    octaves = math.log2(highest / lowest)
    edges = lowest * 2.0 ** (np.arange(int(octaves * BANDS_PER_OCTAVE) + 1) / BANDS_PER_OCTAVE)
    sums = np.add.reduceat(power, np.searchsorted(frequency, edges))[:-1]
    counts = np.diff(np.searchsorted(frequency, edges))
    filled = (counts > 0) & (sums > 0.0)
    centre = np.sqrt(edges[:-1] * edges[1:])
    return Spectrum(label, centre[filled], 10.0 * np.log10(sums[filled]))


def _good_length(count: int) -> int:
    """The longest length up to `count` that a fast transform likes: 2^a or 3 2^a."""
    if count < 4:
        return count
    power = 1 << (count.bit_length() - 1)
    return power + power // 2 if power + power // 2 <= count else power


def send(
    stream: rr.RecordingStream, spectra: list[Spectrum], colours: list[tuple[int, int, int]]
) -> None:
    """Lines over a logarithmic axis of frequency, with grid, numbers and a legend."""
    top = 10.0 * math.ceil(max(s.level_db.max() for s in spectra) / 10.0)
    low = max(top - _FLOOR_DB, 10.0 * math.floor(min(s.level_db.min() for s in spectra) / 10.0))
    first = min(s.frequency_hz[0] for s in spectra)
    last = max(s.frequency_hz[-1] for s in spectra)

    def x(frequency: np.ndarray | float) -> np.ndarray:
        return np.asarray(_WIDTH * np.log(frequency / first) / math.log(last / first))

    def y(level: np.ndarray | float) -> np.ndarray:
        return np.asarray(_HEIGHT * (top - np.maximum(level, low)) / (top - low))

    lines, places, labels = [], [], []
    for frequency, name in _DECADE_NAMES.items():
        if first <= frequency <= last:
            at = float(x(frequency))
            lines.append([(at, 0.0), (at, _HEIGHT)])
            places.append((at, _HEIGHT + 2.8))
            labels.append(name)
    for level in np.arange(low, top + 1.0, 20.0):
        at = float(y(level))
        lines.append([(0.0, at), (_WIDTH, at)])
        places.append((-6.0, at))
        labels.append(f"{level:g} dB")
    stream.log("spectrum/grid", rr.LineStrips2D(lines, colors=_GRID, radii=0.08), static=True)
    _send_words(stream, "spectrum/axes", places, labels, [_TEXT] * len(labels))
    for i, (found, colour) in enumerate(zip(spectra, colours, strict=True)):
        line = np.stack([x(found.frequency_hz), y(found.level_db)], axis=1)
        # The first one, of the run itself, lies over the others.
        strips = rr.LineStrips2D([line], colors=colour, radii=0.18, draw_order=30.0 - i)
        stream.log(f"spectrum/line_{i}", strips, static=True)
    where = [(_WIDTH + 9.0, 4.0 + 5.5 * i) for i in range(len(spectra))]
    _send_words(stream, "spectrum/legend", where, [s.label for s in spectra], colours)


def _send_words(
    stream: rr.RecordingStream,
    path: str,
    places: list[tuple[float, float]],
    labels: list[str],
    colours: list[tuple[int, int, int]],
) -> None:
    points = rr.Points2D(places, labels=labels, colors=colours, radii=0.02, show_labels=True)
    stream.log(path, points, static=True)
