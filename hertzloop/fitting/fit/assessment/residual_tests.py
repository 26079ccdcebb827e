"""Tests of the residual of a fit against the noise of the records."""

import math

import numpy as np
import scipy

from hertzloop.fitting.fit.channels.channel import Channel
from hertzloop.fitting.fit.channels.noise import ljung_box
from hertzloop.fitting.fit.problem.iterate import ChannelIterate, Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem

_F_QUIET = 200  # samples before the impact for the F test to decide alone
_UNSURE = 2.0  # factor on the estimated error of a simulation


class ResidualTests:
    """Tests of the residual of a fit, with the model taken as exact.

    Attributes:
        count: number of F tests.
        smallest: least probability of them, and `shown`: a sentence on the residual of that test.
        beyond: least probability if the error of a coarse simulation is a part of the noise.
        whiteness: least probability of the Ljung-Box tests.
        quiet_known: whether enough samples before the impact tell the noise.
    """

    def __init__(self, problem: FitProblem, iterate: Iterate) -> None:
        self.problem, self.iterate = problem, iterate
        self.contact_s = max(one.contact_s for one in problem.simulators)
        self.count, self.shown = 0, ""
        self.smallest = self.beyond = self.whiteness = 1.0
        self.quiet_known = True
        self._squares, self._samples = 0.0, 0.0
        for c, one in zip(problem.channels, iterate.channels, strict=True):
            self._add(c, one)

    def _add(self, c: Channel, one: ChannelIterate) -> None:
        """Test a channel."""
        rows = self.iterate.residual[one.rows]
        tau, size = one.predicted.tau[one.counted], c.independent(one.counted)
        after = tau > -0.1 * self.contact_s
        self._squares += float(rows[after] @ rows[after])
        self._samples += float(np.sum(size[after]))
        self.whiteness = min(self.whiteness, _whiteness(c, rows[after]))
        if c.noise_unknown:
            enough = c.noise_from != "residual" and c.quiet >= _F_QUIET
            self.quiet_known = self.quiet_known and enough
            return
        self._compare_with_noise(c, rows, tau, size)

    def _compare_with_noise(
        self, c: Channel, rows: np.ndarray, tau: np.ndarray, size: np.ndarray
    ) -> None:
        """Compare the residual of three windows with the noise by F tests.

        Args:
            c: the channel.
            rows: residual over noise, (samples,).
            tau: times after the touch, s, (samples,).
            size: how many independent samples each one is, (samples,).
        """
        share = len(self.iterate.x) / max(len(self.problem.channels), 1)
        known = c.quiet // 2 if len(c.ar) else c.quiet  # colour and size from the same samples
        known = min(known, c.equivalent_samples or known)
        after = tau > -0.1 * self.contact_s
        in_contact = np.sum(size[(tau > 0.0) & (tau < 1.3 * self.contact_s)])
        for end in (1.3 * self.contact_s, 12.0 * self.contact_s, math.inf):
            inside = after & (tau < end)
            part, samples = rows[inside], float(np.sum(size[inside]))
            used = share if end == math.inf else share * min(1.0, samples / float(np.sum(size)))
            free = samples - used
            if free < 8 or (end != math.inf and np.sum(inside) == np.sum(after)):
                continue
            self.count += 1
            ratio = float(part @ part) / free
            p = float(scipy.stats.f.sf(ratio, free, known - 1))
            if p < self.smallest:
                self.smallest = p
                within = "" if end == math.inf else f" in the first {1e6 * end:.3g} us"
                self.shown = f"The residual{within} is {math.sqrt(ratio):.3g} times the noise"
            ratio /= 1.0 + (_UNSURE * c.simulation_error) ** 2 * in_contact / free
            self.beyond = min(self.beyond, float(scipy.stats.f.sf(ratio, free, known - 1)))

    @property
    def f_p(self) -> float | None:
        """Least probability of the F tests, corrected for their number; None without any."""
        return min(1.0, self.smallest * self.count) if self.count else None

    @property
    def white_p(self) -> float:
        """Least probability of the Ljung-Box tests, corrected for their number."""
        return min(1.0, self.whiteness * len(self.problem.channels))

    @property
    def residual_over_noise(self) -> float:
        """Residual of all channels over their noise, root mean square."""
        return math.sqrt(self._squares / max(self._samples - len(self.iterate.x), 1.0))


def _whiteness(c: Channel, rows: np.ndarray) -> float:
    """Probability that white noise has the correlations of a residual; 1 where the errors of a
    converter or of the simulation, which are not white, are larger than the noise."""
    if c.limited_by_simulation or c.simulation_error or (c.step > 0.0 and c.noise < 0.7 * c.step):
        return 1.0
    if len(rows) <= 30:
        return 1.0
    return ljung_box(rows, whitened_by=c.quiet if len(c.ar) else 0)
