"""Spectra as a drawing with axes of its own: the viewer's plots know time only."""

import math
from dataclasses import dataclass

import numpy as np
import rerun as rr

BANDS_PER_OCTAVE = 12
_FADES = 0.25  # share of a run over which its end fades out
_NARROW = 0.4  # share of a band that a bar in front of another fills
_REFERENCE_DB = 120.0  # of 1 m/s over 1 um/s: over 1 nm/s bars would all look alike


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
    """Bars over the logarithm of the frequency; those of the first spectrum are narrower than those
    behind them."""
    width = math.log10(2.0) / BANDS_PER_OCTAVE
    for i, (found, colour) in enumerate(zip(spectra, colours, strict=True)):
        share = 1.0 if i else _NARROW
        bars = rr.BarChart(
            np.maximum(found.level_db + _REFERENCE_DB, 0.0),
            abscissa=np.log10(found.frequency_hz),
            widths=np.full(len(found.level_db), share * width),
            color=colour,
        )
        # By names that come first, since the viewer draws later ones over them.
        name = found.label.replace(" ", "_")
        stream.log(f"spectrum/{f'0_{name}' if i else name}", bars, static=True)
