"""Fields and notes that the results of a fit and of a check share."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from hertzloop.fitting.fit.assessment.assessment import ModelAssessment
from hertzloop.fitting.fit.assessment.residuals import describe_nuisances
from hertzloop.fitting.fit.problem.iterate import Iterate
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.fit.uncertainty.key_uncertainty import KeyUncertainty
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.record import Record


def common_fields(
    problem: FitProblem,
    plain: Iterate,
    known: KeyUncertainty,
    assessment: ModelAssessment,
) -> dict[str, Any]:
    """Return fields of a result, by name.

    Args:
        problem: the fit.
        plain: its solution, with the model taken as exact.
        known: uncertainty of the keys.
        assessment: verdict on the model.
    """
    return {
        "nuisances": describe_nuisances(problem, plain),
        "noise_rms": problem.channels[0].noise,
        "residual_over_noise": assessment.residual_over_noise,
        "model": assessment.verdict,
        "statistics": assessment.as_json(),
        "reasons": assessment.reasons,
        "covariance": known.covariance,
        "notes": [note for c in problem.channels for note in c.notes],
        "evaluations": problem.counter.done,
    }


def check_sample_count(iterate: Iterate) -> None:
    """Raise RecordError if there are fewer samples than unknowns that no prior holds."""
    samples = sum(one.rows.stop - one.rows.start for one in iterate.channels)
    unknowns = len(iterate.x) - (iterate.prior_rows.stop - iterate.prior_rows.start)
    if samples <= unknowns:
        raise RecordError(
            f"the records have {samples} samples for {unknowns} unknowns. "
            "Record at a higher rate, or free fewer keys."
        )


def unique_names(records: Sequence[Record]) -> list[Record]:
    """Return the records, with a number behind each name that an earlier one has. Raises
    RecordError for a record that is given twice."""
    found: list[Record] = []
    for record in records:
        if any(record.repeats(other) for other in found):
            raise RecordError(
                f"{record.name}: is given twice, and would count twice. Name each record once."
            )
        name, count = record.name, 1
        while any(name == other.name for other in found):
            count += 1
            name = f"{record.name} ({count})"
        found.append(replace(record, name=name))
    return found
