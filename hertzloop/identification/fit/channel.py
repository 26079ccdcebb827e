"""A record made ready for a fit: what is used of it, its noise, and where the impact is."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from hertzloop.identification.fit.discrepancy import Discrepancy
from hertzloop.identification.fit.observation import ObservedSignal
from hertzloop.identification.records.converter import clipped_samples, converter_step
from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.quantities import QUANTITIES
from hertzloop.identification.records.record import Record

_SURE = 8.0  # noise levels that a sample has to leave the baseline by
_STEADY = 7  # samples, most of which have to have left it
_ONSET_SHARE = 0.02  # of the peak, the same
_REST = 3  # lengths of the contacts in a force, after which it rests
_FEWEST_QUIET = 12  # samples before the impact, for an estimate of the noise
ENOUGH_QUIET = 100  # for one that a test of the model can rest on; the last of them are not counted
# Of the peak: the error of the simulation and its splines. The acceleration of the contact point
# converges slowly with the number of modes, and without a filter hardly at all.
_FLOOR = {"v_p": 1e-4, "acceleration": 4e-4}
_FLOOR_OF_GAP, _FLOOR_UNFILTERED = 5e-5, 2e-3
_UNKNOWN_CONTACTS = 1.6
_FASTEST_HZ = 300e3  # of a filter that makes an acceleration converge
_RESOLVED = 0.6  # steps of a converter: noise above it can be read off
_LONG_RUN = 8  # samples on one level, more than a slope makes
_SPIKE = 6.0  # deviations, of single samples before the impact
_AR_FROM, _AR_MOST = 300, 8  # quiet samples for a model of coloured noise, its highest order
_AR_P = 1e-5  # probability of white noise below which the noise counts as coloured
_LAGS = 10  # of the test of a residual
_WINDOW = (-0.5, 1.6)  # of a contact, in which a record is aligned
_FEWEST_ALIGNED, _MOST_ALIGNED = 4, 600  # samples
_LEAST_GAIN, _MOST_GAIN = 1 / 3, 3.0
_LATE = 0.1  # of the time of a wave from the contact to the sensor, that a scene may be off
_ALIKE = 0.3  # of the power, that a simulation may leave of a record
_MOST_SHIFTS = 1500  # of a search through a whole record
_MOST_SAMPLES = 60_000
_DENSE_CONTACTS = 12.0


@dataclass
class Channel:
    """A record made ready.

    `time_s`, `value`: the samples that are used, (samples,). `kept`: which of them count; the
    others are clipped or spikes. `noise`: standard deviation of a sample; `noise_from`: "quiet",
    "differences" or "residual". `quiet`: samples before the impact that the noise rests on.
    `step`: distance of two levels of a visible converter. `ar`: coefficients of coloured noise,
    and `innovation`: the standard deviation of its driving noise, over `noise`. `touch_s`: the
    record's time of the first touch, as first found. `notes`: sentences for the user. `floored`:
    whether the simulation's own error is larger than the noise. `coarse`: error of the simulation
    during contact over the noise, where a test of the model would show it, else zero. `phase`:
    under a law, from the last sample of the sensor to the touch, as first found, in steps.
    `alike`: how many samples of a finer converter would show the noise as well; None of a converter
    with steps below the noise. `weight`: of each sample in a fit, (samples,), None if all are one.
    """

    record: Record
    time_s: np.ndarray
    value: np.ndarray
    kept: np.ndarray
    peak: float
    noise: float
    noise_from: str
    quiet: int
    baseline: float
    step: float
    ar: np.ndarray
    innovation: float
    onset_s: float
    has_quiet_start: bool
    touch_s: float = math.nan
    gain: float = 1.0
    offset: float = 0.0
    ppm: float = 0.0
    phase: float = 0.5
    notes: list[str] = field(default_factory=list)
    rejected: int = 0
    floored: bool = False
    coarse: float = 0.0
    alike: int | None = None
    weight: np.ndarray | None = None
    least_noise: float = 0.0
    discrepancy: Discrepancy | None = None

    @property
    def is_gap(self) -> bool:
        """Whether the values are distances from the plate, which are not zero at rest."""
        return self.record.quantity in ("xi", "xi_s")

    @property
    def elsewhere(self) -> bool:
        """Whether the values are of another point than that of the contact."""
        return self.record.measurement.point_m is not None

    @property
    def noise_unknown(self) -> bool:
        """Whether the samples before the impact are too few for the noise."""
        return self.quiet < ENOUGH_QUIET

    @property
    def contact_unknown(self) -> bool:
        """Whether the simulation does not converge during contact."""
        return is_unfiltered_acceleration(self.record)

    @property
    def interval_s(self) -> float:
        """Median distance of samples, s."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def noise_over_peak(self) -> float:
        """Noise over the largest deviation from the baseline."""
        return self.noise / self.peak

    def after_touch_s(self, touch_s: float, ppm: float) -> np.ndarray:
        """True times after the first touch, s: the record's clock is fast by `ppm`."""
        return (self.time_s - touch_s) / (1.0 + 1e-6 * ppm)

    @property
    def duration_s(self) -> float:
        """From the first touch to the last sample, s."""
        return float(self.time_s[-1]) - self.touch_s

    def whitened(self, rows: np.ndarray) -> np.ndarray:
        """Divide rows of a residual or of its derivatives by the noise, and take its colour out.

        Args:
            rows: shape (samples,) or (samples, columns), zero where samples do not count.

        Returns:
            Rows with white noise of standard deviation one, the same shape.
        """
        scaled = rows / self.noise
        if self.weight is not None:
            scaled = (scaled.T * self.weight).T
        if not len(self.ar):
            return scaled
        found = scipy.signal.lfilter(np.concatenate([[1.0], -self.ar]), [1.0], scaled, axis=0)
        return np.asarray(found / self.innovation)

    def prior_sds(self, exact: bool = False) -> tuple[float, float]:
        """Standard deviations of the priors of gain and clock (ppm); unless the model is `exact`,
        with the errors of the model that a whole record shares."""
        m = self.record.measurement
        common = 0.0 if exact or self.discrepancy is None else self.discrepancy.overall
        return (
            max(math.hypot(m.sensitivity_uncertainty, common), 1e-9),
            max(math.hypot(m.clock_tolerance_ppm, 1e6 * common), 1e-6),
        )

    def whitening(self) -> Any:
        """The matrix of `whitened`, (samples, samples)."""
        n = len(self.time_s)
        scale = (self.weight if self.weight is not None else np.ones(n)) / self.noise
        taps = [np.ones(n), *(np.full(n - k, -a) for k, a in enumerate(self.ar, 1))]
        # pyrefly: ignore[no-matching-overload]
        memory: Any = scipy.sparse.diags_array(taps, offsets=[-k for k in range(len(taps))])
        return (memory @ scipy.sparse.diags_array(scale / self.innovation)).tocsr()

    def independent(self, counted: np.ndarray) -> np.ndarray:
        """How many independent samples each of the counted rows is; shape (rows,)."""
        if self.weight is None:
            return np.ones(np.count_nonzero(counted))
        return np.asarray(self.weight[counted] ** 2)

    def counted(self, within: np.ndarray) -> np.ndarray:
        """Which rows count: kept samples `within`, whose predecessors count as well where the
        noise has a memory; shape (samples,)."""
        good = self.kept & within
        for lag in range(1, len(self.ar) + 1):
            good[lag:] &= self.kept[:-lag]
            good[:lag] = False
        return good


def prepare_channel(record: Record) -> Channel:
    """Find peak, baseline, onset and noise of a record.

    Raises:
        RecordError: there is no impact in it.
    """
    notes = list(record.notes)
    known = np.isfinite(record.value)
    cut = clipped_samples(record)
    if np.any(cut):
        notes.append(
            f"{record.name}: {np.count_nonzero(cut)} samples are at the end of the range and are "
            "not used."
        )
    value = np.where(known, record.value, np.nan)
    time_s = record.time_s
    good = known & ~cut
    values = value[good]
    if float(np.ptp(values)) == 0.0:
        raise RecordError(
            f"{record.name}: all values are {values[0]:g}. Give a record with an impact."
        )
    step = converter_step(record)
    is_gap = record.quantity in ("xi", "xi_s")
    start = max(_FEWEST_QUIET // 2, min(len(values) // 50, 500))
    baseline = float(np.median(values[:start]))
    # A record that begins in the contact has no quiet start; its third differences are quiet.
    spread = 1.4826 * float(np.median(np.abs(values[:start] - baseline)))
    rough = 1.4826 * float(np.median(np.abs(np.diff(values, 3)))) / math.sqrt(20.0)
    spread = max(min(spread, 3.0 * max(rough, 1e-3 * spread)), 0.3 * step)
    if is_gap:
        baseline = 0.0
    peak = float(np.nanmax(np.abs(np.where(known, value, baseline) - baseline)))
    if not is_gap:
        _check_impact(record, values - baseline, max(spread, rough))
    filled = np.where(known, value, baseline)
    onset = _find_onset(filled, baseline, spread, peak, is_gap)
    quiet_start = onset >= _FEWEST_QUIET and not is_gap
    # After the last contact a force is as quiet as before it, and tells the noise too.
    pushed = np.flatnonzero(np.abs(filled - baseline) > max(_SURE * spread, _ONSET_SHARE * peak))
    end = len(values)
    if record.quantity == "contact_force" and onset < ENOUGH_QUIET and len(pushed):
        end = 1 + int(pushed[-1]) + _REST * (1 + int(pushed[-1]) - onset)
    after = filled[end:][good[end:]]
    noise, source, quiet, alike = 0.0, "residual", 0, None
    ar, innovation = np.empty(0), 1.0
    if quiet_start:
        margin = 3 + onset // 20
        before = filled[: onset - margin][good[: onset - margin]]
        before, enough = before - np.median(before), len(before) >= _AR_FROM
        if len(after) >= ENOUGH_QUIET:
            before = np.concatenate([before, after - np.median(after)])
            filled, time_s, good = filled[:end], time_s[:end], good[:end]
        sd = 1.4826 * float(np.median(np.abs(before))) or float(np.std(before))
        calm = before[np.abs(before) <= _SPIKE * max(sd, 0.5 * step, 1e-300)]
        if len(calm) >= _FEWEST_QUIET:
            noise, source, quiet = float(np.std(calm, ddof=1)), "quiet", len(calm)
            if noise < _RESOLVED * step:
                noise, alike = noise_below_converter_step(calm, step)
            spikes = len(before) - len(calm)
            if enough and spikes == 0 and noise > step:
                ar, innovation = autoregressive_noise(before)
    elif is_gap:
        third = np.diff(values, 3)
        noise, source = float(np.std(third)) / math.sqrt(20.0), "differences"
        quiet = len(third) // 4
    noise, floored = max(noise, step / math.sqrt(12.0)), False
    floor = simulation_error_share(record, notes) * peak
    if source != "residual":
        floored = noise < floor
        noise = math.hypot(noise, floor)
    else:
        noise = max(0.01 * peak, step)
    if quiet < ENOUGH_QUIET and source != "differences":
        notes.append(
            f"{record.name}: only {quiet} samples before the impact tell its noise, so the fit "
            "estimates it from the whole record. Record at least 150 samples before the trigger."
        )
    if len(ar):
        notes.append(
            f"{record.name}: its noise has a memory; it is modelled by {len(ar)} coefficients from "
            "the samples before the impact."
        )
    return Channel(
        record=record,
        time_s=time_s,
        value=filled,
        kept=good,
        peak=peak,
        noise=noise,
        noise_from=source,
        quiet=quiet,
        baseline=baseline,
        step=step,
        ar=ar,
        innovation=innovation,
        onset_s=float(time_s[onset]),
        has_quiet_start=quiet_start or is_gap,
        notes=notes,
        floored=floored,
        alike=alike,
        least_noise=math.hypot(step / math.sqrt(12.0), floor),
    )


def noise_below_converter_step(readings: np.ndarray, step: float) -> tuple[float, int]:
    """Noise of readings away from the baseline, where a converter hides most of it.

    The readings before the impact rest on one level or change between two, whichever the baseline
    is near. The noise before the converter follows from the share of each level; every baseline
    and every noise up to a step is equally probable before.

    Returns:
        Standard deviation with that of the converter, and how many samples would show it as well.
    """
    levels = np.round((readings - readings[0]) / step).astype(int)
    values, counts = np.unique(levels, return_counts=True)
    values = values - values[np.argmax(counts)]
    sigma = np.linspace(0.01, 1.0, 100)[:, np.newaxis, np.newaxis]
    mean = np.linspace(-1.0, 1.0, 161)[:, np.newaxis]
    upper, lower = (scipy.special.ndtr((values + half - mean) / sigma) for half in (0.5, -0.5))
    likely = np.sum(counts * np.log(np.maximum(upper - lower, 1e-300)), axis=-1)
    weight = np.exp(likely - np.max(likely)).sum(axis=1)
    variance = sigma[:, 0, 0] ** 2 + 1.0 / 12.0
    found = float(np.average(variance, weights=weight))
    spread = float(np.average((variance - found) ** 2, weights=weight))
    alike = 2.0 * found**2 / max(spread, 1e-12)
    return step * math.sqrt(found), int(min(len(readings), alike))


def is_unfiltered_acceleration(record: Record) -> bool:
    """Whether a record is an acceleration at the contact point without a filter."""
    if record.quantity != "acceleration" or record.measurement.point_m is not None:
        return False
    limits = [f for f in (record.measurement.low_pass_hz, record.measurement.resonance_hz) if f]
    return not limits or min(limits) > _FASTEST_HZ


def simulation_error_share(record: Record, notes: list[str]) -> float:
    """Error of the simulation, of the peak."""
    if is_unfiltered_acceleration(record):
        notes.append(
            f"{record.name}: without a filter the acceleration at the contact point has no "
            "limit during contact, so samples there are not used. Give record.low_pass_hz, "
            "the bandwidth of the accelerometer."
        )
        return _FLOOR_UNFILTERED
    return _FLOOR.get(record.quantity, _FLOOR_OF_GAP)


def _check_impact(record: Record, values: np.ndarray, spread: float) -> None:
    """Refuse a record that never leaves its noise for two samples in a row."""
    size = np.abs(values)
    pairs = np.minimum(size[1:], size[:-1])
    if float(np.max(pairs)) < 6.0 * spread:
        if float(np.max(size)) > _SPIKE * 6.0 * spread:
            raise RecordError(
                f"{record.name}: only single samples leave the noise, up to "
                f"{float(np.max(size)):.3g} {QUANTITIES[record.quantity].unit}, at "
                f"{1e6 * record.interval_s:.3g} us from sample to sample. The impact is shorter. "
                "Record at a higher rate."
            )
        raise RecordError(
            f"{record.name}: no impact was found, as the largest value is "
            f"{float(np.max(size)):.3g} {QUANTITIES[record.quantity].unit} at a noise of "
            f"{spread:.3g}. Give a record with an impact."
        )


def _find_onset(
    value: np.ndarray, baseline: float, spread: float, peak: float, is_gap: bool
) -> int:
    """The first sample that has clearly left the baseline, or the first below zero of a gap."""
    if is_gap:
        below = np.flatnonzero(value < 0.0)
        return int(below[0]) if len(below) else int(np.argmin(value))
    size = np.abs(value - baseline)
    steady = scipy.ndimage.median_filter(size, _STEADY, mode="constant")
    if float(np.max(steady)) > 0.3 * peak:
        # Enough samples in the contact: a few spikes in a row are no impact.
        peak = min(peak, 1.5 * float(np.max(steady)))
        size = steady
    out = size > max(_SURE * spread, _ONSET_SHARE * peak)
    both = out & np.append(out[1:], True)
    found = np.flatnonzero(both)
    return int(found[0]) if len(found) else int(np.argmax(size))


def autoregressive_noise(before: np.ndarray) -> tuple[np.ndarray, float]:
    """Autoregressive coefficients of noise that is not white; none of white noise.

    Returns:
        Coefficients, shape (order,), and the driving noise over the noise.
    """
    if ljung_box(before) >= _AR_P:
        return np.empty(0), 1.0
    n = len(before)
    lags = np.array([np.dot(before[: n - k], before[k:]) / n for k in range(_AR_MOST + 1)])
    best: tuple[float, np.ndarray, float] = (math.inf, np.empty(0), 1.0)
    for order in range(1, _AR_MOST + 1):
        phi = scipy.linalg.solve_toeplitz(lags[:order], lags[1 : order + 1])
        share = max(1.0 - float(phi @ lags[1 : order + 1]) / lags[0], 1e-6)
        score = n * math.log(share) + math.log(n) * order
        if score < best[0]:
            best = (score, phi, math.sqrt(share))
    return best[1], best[2]


def ljung_box(residual: np.ndarray, whitened_by: int = 0) -> float:
    """Return the probability that white noise has correlations as large as a residual's, at ten
    lags.

    Args:
        residual: shape (samples,).
        whitened_by: how many other samples the colour of the noise was found from; their errors
            leave correlations of their own. Zero of noise that needed no whitening.

    Source: Ljung and Box 1978, Biometrika 65, 297.
    """
    n = len(residual)
    if n <= 2 * _LAGS:
        return 1.0
    r = residual - np.mean(residual)
    power = float(r @ r)
    if power == 0.0:
        return 1.0
    rho = np.array([float(r[:-k] @ r[k:]) / power for k in range(1, _LAGS + 1)])
    q = n * (n + 2) * float(np.sum(rho * rho / (n - np.arange(1, _LAGS + 1))))
    if whitened_by:
        q /= 1.0 + n / whitened_by
    return float(scipy.stats.chi2.sf(q, _LAGS))


def align(channel: Channel, observed: ObservedSignal, contact_s: float) -> None:
    """Find the touch, gain and offset of a channel by correlation with a simulated record.

    Raises:
        RecordError: gain or sign say that unit, sensitivity or sign are wrong.
    """
    record = channel.record
    kept_s = channel.time_s[channel.kept]
    if (
        np.min(kept_s[_FEWEST_ALIGNED - 1 :] - kept_s[: 1 - _FEWEST_ALIGNED], initial=math.inf)
        >= (_WINDOW[1] - _WINDOW[0]) * contact_s
    ):
        raise _too_coarse(channel, contact_s)
    ringing_s = observed.chain.before_s  # a brick wall shows the impact before the touch
    grid_s = observed.spline.x if ringing_s else observed.simulated.time_s
    fine = observed.value(grid_s)
    first = grid_s <= 2.0 * contact_s
    shown = float(np.max(np.abs(fine[first])))
    if shown == 0.0:
        shown = float(np.max(np.abs(fine)))
    # An interval that is longer than the contact is that of another part of the record.
    reach_s = max(8e-6, 3.0 * min(channel.interval_s, contact_s), 0.35 * contact_s)
    reach_s = max(reach_s, 0.5 * ringing_s)
    late_s, share = 0.0, _ONSET_SHARE
    if record.quantity == "actuator_force" or channel.elsewhere:  # may come after the contact
        shown = float(np.max(np.abs(fine)))
        if channel.elsewhere:
            share = max(share, _SURE * channel.noise_over_peak)
        late_s = max(0.0, float(grid_s[np.argmax(np.abs(fine) > share * shown)]))
        reach_s = max(reach_s, _LATE * late_s)
    if channel.is_gap:
        guess = channel.onset_s
    elif channel.has_quiet_start:
        early = np.abs(fine) > share * shown
        guess = channel.onset_s - float(grid_s[np.argmax(early)])
    else:
        guess = float(channel.time_s[0]) - 0.2 * contact_s
        reach_s = 1.5 * contact_s
    step_s = max(0.25e-6, contact_s / 120.0)
    best = _best_shift(channel, observed, guess, reach_s, step_s, contact_s, late_s)
    known_gain = math.isfinite(record.measurement.sensitivity_uncertainty)
    wrong = best is not None and not _LEAST_GAIN <= best[2] <= _MOST_GAIN
    if best is not None and not best[4] and wrong and known_gain:
        # A few spikes in a row can look like the onset: look everywhere, then closer.
        middle = 0.5 * float(channel.time_s[0] + channel.time_s[-1])
        half = 0.5 * float(channel.time_s[-1] - channel.time_s[0])
        rough_s = max(contact_s / 15.0, 2.0 * half / _MOST_SHIFTS)
        anywhere = _best_shift(channel, observed, middle, half, rough_s, contact_s, late_s)
        alike = anywhere is not None and anywhere[0] < _ALIKE and not anywhere[4]
        if anywhere is not None and alike and _LEAST_GAIN <= anywhere[2] <= _MOST_GAIN:
            closer = 2.0 * rough_s
            best = _best_shift(channel, observed, anywhere[1], closer, step_s, contact_s, late_s)
    if best is None:
        raise _too_coarse(channel, contact_s)
    _, touch_s, gain, offset, mirrored = best
    if gain < 0.0 or mirrored:
        raise RecordError(
            f"{record.name}: the record has the opposite sign of the simulation. Give "
            f"record.sensitivity = {-record.measurement.sensitivity:g}, or change the sign."
        )
    if not known_gain or _LEAST_GAIN <= gain <= _MOST_GAIN:
        channel.touch_s, channel.gain, channel.offset = touch_s, gain, offset
    else:
        raise RecordError(
            f"{record.name}: the record is {gain:.3g} times the simulation. Check record.unit, "
            "record.sensitivity, the starting values of the scene, and that time_s is in seconds. "
            "Of an unknown sensitivity, write record.sensitivity_uncertainty = inf."
        )


def _too_coarse(channel: Channel, contact_s: float) -> RecordError:
    return RecordError(
        f"{channel.record.name}: too few samples are in the contact of {1e6 * contact_s:.3g} us, "
        f"at {1e6 * channel.interval_s:.3g} us from sample to sample. Record at a higher rate, and "
        "check that time_s is in seconds; if it is not, name the column time_us, for example."
    )


def _best_shift(
    channel: Channel,
    observed: ObservedSignal,
    guess: float,
    reach_s: float,
    step_s: float,
    contact_s: float,
    late_s: float,
) -> tuple[float, float, float, float, bool] | None:
    """Cost, touch, gain, offset, and whether a negative gain fits better by far. `late_s`: from
    the touch to the first contact time that counts."""
    best: tuple[float, float, float, float] | None = None
    turned = math.inf
    for shift in np.arange(-reach_s, reach_s + step_s, step_s):
        touch_s = guess + float(shift)
        tau = channel.time_s - touch_s
        after_s = tau - late_s
        window = channel.kept & (after_s > _WINDOW[0] * contact_s)
        window &= after_s < _WINDOW[1] * contact_s
        where = np.flatnonzero(window)
        if len(where) < _FEWEST_ALIGNED:
            continue
        if len(where) > _MOST_ALIGNED:
            where = where[:: len(where) // _MOST_ALIGNED + 1]
        model, y = observed.value(tau[where]), channel.value[where]
        mean, of_y = float(np.mean(model)), float(np.mean(y))
        power = float(np.sum((model - mean) ** 2))
        shown = float(np.mean((y - of_y) ** 2))
        if power == 0.0 or shown == 0.0:  # of a converter that stays at one level
            continue
        gain = float(np.sum((model - mean) * (y - of_y))) / power
        left = float(np.mean((y - of_y - gain * (model - mean)) ** 2)) / shown
        if gain < 0.0:
            turned = min(turned, left)
        elif best is None or left < best[0]:
            best = (left, touch_s, gain, of_y - gain * mean)
    if best is None:
        return None if turned == math.inf else (turned, guess, -1.0, 0.0, True)
    return (*best, turned < 0.3 * best[0] and turned < 0.2)


def weight_equal_readings(channel: Channel) -> None:
    """Give the samples of a long run of equal readings together the weight of one sample.

    Where the noise is hidden in the steps of a converter, they share one error: the readings before
    the impact would fix the offset to a level of the converter, up to half a step from the truth.
    """
    if channel.alike is None:
        return
    starts = np.flatnonzero(np.diff(channel.value, prepend=math.nan) != 0.0)
    lengths = np.diff(np.append(starts, len(channel.value)))
    each = np.repeat(np.where(lengths > _LONG_RUN, lengths, 1), lengths)
    channel.weight = 1.0 / np.sqrt(each)


def exclude_contact(channel: Channel, contact_s: float) -> None:
    """Leave the contact out of an acceleration without a filter, where the record goes on long
    enough: there it grows with the number of modes."""
    if not channel.contact_unknown or channel.duration_s < 4.0 * contact_s:
        return
    tau = channel.time_s - channel.touch_s
    channel.kept = channel.kept & ~((tau > -1e-6) & (tau < _UNKNOWN_CONTACTS * contact_s))


def thin_samples(channel: Channel, contact_s: float) -> None:
    """Use every sample of the first contacts, and of a very long record every n-th beyond."""
    n = len(channel.time_s)
    if n <= _MOST_SAMPLES:
        return
    tau = channel.time_s - channel.touch_s
    dense = np.abs(tau) < _DENSE_CONTACTS * contact_s
    every = max(1, math.ceil((n - np.count_nonzero(dense)) / (0.7 * _MOST_SAMPLES)))
    keep_dense = max(1, math.ceil(np.count_nonzero(dense) / (0.3 * _MOST_SAMPLES)))
    index = np.arange(n)
    if keep_dense == 1:
        chosen = dense | (index % every == 0)
    else:
        chosen = np.where(dense, index % keep_dense == 0, index % every == 0)
    channel.time_s, channel.value = channel.time_s[chosen], channel.value[chosen]
    channel.kept = channel.kept[chosen]
    channel.ar, channel.innovation = np.empty(0), 1.0
    channel.notes.append(
        f"{channel.record.name}: of {n} samples {np.count_nonzero(chosen)} are used, every "
        f"{every}th beyond the first {_DENSE_CONTACTS:g} contact times."
    )
