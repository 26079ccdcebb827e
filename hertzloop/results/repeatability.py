"""Whether the closed loop of a recording can be simulated again here."""

from dataclasses import dataclass
from enum import Enum, auto

from hertzloop.recordings.recording import Recording
from hertzloop.results.recorded import RecordedLaw, law_of
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import parse

MOST_WORK = 2e9  # steps times frequencies of a run that is repeated only to judge a recording


class WhyNotRepeatable(Enum):
    """Why a run's closed loop cannot be simulated again."""

    NOT_ENDED = auto()
    OTHER_LAW = auto()
    TOO_LONG = auto()
    NOT_HERE = auto()
    LAW_STOPPED = auto()


@dataclass(frozen=True)
class NotRepeatable:
    """Why a run cannot be simulated again, with the law that ran if it is not the law of the scene,
    or the sentence of an error."""

    reason: WhyNotRepeatable
    law: RecordedLaw | None = None
    error: str = ""


def why_not_repeatable(recording: Recording, most_work: float = MOST_WORK) -> NotRepeatable | None:
    """Return why the closed loop of a recording cannot be simulated again here; None if it can."""
    if recording.balance is None:
        return NotRepeatable(WhyNotRepeatable.NOT_ENDED)
    law = law_of(recording)
    if not law.as_announced:
        return NotRepeatable(WhyNotRepeatable.OTHER_LAW, law)
    if recording.balance.frequencies * recording.truth.samples > most_work:
        return NotRepeatable(WhyNotRepeatable.TOO_LONG)
    try:
        parse(recording.scene_toml)
    except (SceneError, RecursionError) as error:
        return NotRepeatable(WhyNotRepeatable.NOT_HERE, error=str(error))
    return None
