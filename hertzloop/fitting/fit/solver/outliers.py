"""Take isolated outliers out of the records of a fit."""

import numpy as np

from hertzloop.fitting.fit.problem.iterate import Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.records.statistics import robust_deviation

OUTLIER = 4.0  # robust deviations
_MOST_OUTLIERS = 0.06
_FEW = 60  # samples of a pulse, none of which is taken out
_LONGEST_RUN = 2  # outliers in a row; longer ones are a misfit


def reject_outliers(problem: FitProblem, iterate: Iterate) -> bool:
    """Take isolated samples out that are more than four robust deviations away.

    Returns:
        Whether there were any. A run of more than two is a misfit and stays, as do all if they are
        more than 6 % of a record.
    """
    found = False
    channels = zip(problem.channels, iterate.channels, problem.simulators, strict=True)
    for c, (predicted, _, _), simulator in channels:
        tau, residual = predicted.tau, np.where(c.kept, predicted.reading - c.value, 0.0)
        used = c.kept & (tau <= iterate.until_s)
        if np.count_nonzero(used) < 20:
            continue
        sd = robust_deviation(residual[used])
        sd = max(sd, c.noise if c.noise_from == "quiet" else 0.0, 0.5 * c.step)
        far = used & (np.abs(residual) > OUTLIER * sd)
        contact = (tau > -0.5 * simulator.contact_s) & (tau < 1.5 * simulator.contact_s)
        if np.count_nonzero(contact) < _FEW:  # a misfit of the pulse is as short as an outlier
            far &= ~contact
        runs = np.split(np.flatnonzero(far), np.flatnonzero(np.diff(np.flatnonzero(far)) > 1) + 1)
        single = [i for run in runs if 0 < len(run) <= _LONGEST_RUN for i in run]
        if len(single) > _MOST_OUTLIERS * np.count_nonzero(used):
            continue
        # Of Gauss's noise 6 samples of 100 000 are as far out; these cost nothing.
        if single:
            c.kept = c.kept.copy()
            c.kept[np.array(single)] = False
            c.rejected += len(single)
            found = True
    return found
