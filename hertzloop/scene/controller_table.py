"""The table `[controller]`: the law with its keys, and the path of its force."""

from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, ValidationError, ValidationInfo, model_validator
from pydantic.fields import FieldInfo

from hertzloop.controller.loading.law import Law, LawError
from hertzloop.controller.loading.registry import (
    NO_CONTROL,
    check_one_file,
    find,
    resolve,
    shipped_keys,
)
from hertzloop.controller.loading.registry import shipped as shipped_laws
from hertzloop.scene.errors import sentence, shown, unknown_key
from hertzloop.scene.tables import SceneTable

DEFAULT_LAW = "slope_threshold"
# Laws of checked tables by reference and digest: a case asks for its law a dozen times.
_CHECKED: dict[tuple[str, str], Law] = {}
_MOST_CHECKED = 64


class ControllerTable(SceneTable):
    """The law, the signal path to the actuator, and the law's own keys.

    `law`: a shipped name, "mine.py", "mine.py:Name", "package.module:Name", an entry point's name,
    "mine.so" or "mine.fmu". A key that the law does not have is refused, unless it has the default
    of the shipped laws that have it.
    `law_digest`: of a law that is not shipped; one with another digest is refused.
    """

    model_config = ConfigDict(extra="allow")

    law: str = DEFAULT_LAW
    """control law: a shipped name, a file (mine.py, mine.so, mine.fmu), or package.module:Name"""
    law_digest: str | None = None
    """required digest of a law that is not shipped"""
    latency_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    """latency in addition to one step"""
    latency_trace: tuple[Annotated[float, Field(ge=0.0, le=1e6)], ...] | None = None
    """latencies by sample, us, in place of latency_us: a file, a table with file and what it leaves
    open, or a list"""
    latency_trace_use: Literal["replay", "resample"] | None = None
    """replay the trace as it is, or resample blocks of it by the seed; default: replay"""
    latency_trace_from: Literal["sample", "tick"] | None = None
    """start of the latencies of the trace: the sample, or the tick of the controller's clock;
    default: sample"""
    jitter_us: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    """largest random addition to the latency; commands keep their order"""
    clock_ppm: Annotated[float, Field(ge=-1e5, le=1e5)] = 0.0
    """how fast the controller's own clock is, positive if it gains on the plant's; a command waits
    for its first tick at or after the sample"""
    clock_phase: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    """first tick of the controller's clock after the start, in periods of this clock"""
    drop_out_probability: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    """probability that a command drops out; the last command is then held"""
    bits: Annotated[int, Field(ge=2, le=24)] | Literal["ideal"] = "ideal"
    """DAC resolution, bits"""
    full_scale_n: Annotated[float, Field(ge=1e-9, le=1e9)] | None = None
    """largest force of the DAC in either direction"""
    slew_n_s: Annotated[float, Field(ge=1e-9, le=1e15)] | None = None
    """slew rate limit of the force"""

    @property
    def loaded_law(self) -> Law:
        """The law. Its file is read, and its digest compared, when a table is checked. Raises
        LawError."""
        known = _CHECKED.get((self.law, self.law_digest or ""))
        return known or find(self.law, self.law_digest)

    @property
    def has_law(self) -> bool:
        """Whether there is control at all."""
        return self.law != NO_CONTROL

    @property
    def law_is_shipped(self) -> bool:
        """Whether the law comes with hertzloop."""
        return self.law in shipped_laws()

    @property
    def keys(self) -> Any:
        """The law's own keys."""
        given = self.__pydantic_extra__ or {}
        own = self.loaded_law.key_names
        return SimpleNamespace(**{name: given[name] for name in own if name in given})

    @property
    def whole_step_keys(self) -> tuple[str, ...]:
        """Keys that must be a whole number of steps. Raises LawError."""
        return ("latency_us", "jitter_us", *self.loaded_law.whole_steps)

    @model_validator(mode="after")
    def _keys_of_laws(self, info: ValidationInfo) -> "ControllerTable":
        """Check the law's keys, fill in its defaults, drop keys of other laws at their default."""
        given = self.__pydantic_extra__
        assert given is not None
        try:
            law = find(self.law, self.law_digest)
        except LawError:
            if is_recorded(info):
                return self
            raise
        own = law.keys.model_fields
        if taken := [name for name in own if name in ControllerTable.model_fields]:
            raise ValueError(
                f"controller.law = '{self.law}': its key {taken[0]} is a key of the control loop. "
                "Rename it in the law."
            )
        for name, value in given.items():
            if name in own:
                continue
            others = shipped_keys()
            if name not in others:
                known = [*ControllerTable.model_fields, *own]
                raise ValueError(unknown_key(("controller", name), known))
            if value != others[name].default and not is_recorded(info):
                raise ValueError(_of_another_law(name, value, law))
        try:
            mine = law.keys.model_validate({k: v for k, v in given.items() if k in own})
        except ValidationError as error:
            raise ValueError(sentence(error, law.keys, ("controller",))) from error
        given.clear()
        given.update(vars(mine))
        if law.name not in shipped_laws():
            self.__dict__["law_digest"] = law.digest
            if len(_CHECKED) >= _MOST_CHECKED:
                _CHECKED.clear()
            _CHECKED[self.law, law.digest] = law
        return self


def without_law(table: ControllerTable) -> ControllerTable:
    line: dict[str, Any] = {name: getattr(table, name) for name in ControllerTable.model_fields}
    line |= {"law": NO_CONTROL, "law_digest": None}
    return ControllerTable.model_construct(**line)


def is_recorded(info: ValidationInfo) -> bool:
    """Whether a scene is read from a recording, which may outlive its law."""
    return bool(info.context and info.context.get("recorded"))


def law_key(table: ControllerTable, name: str) -> FieldInfo | None:
    """What is known of a key: the signal path's, the law's, or a shipped law's."""
    for fields in (
        ControllerTable.model_fields,
        table.loaded_law.keys.model_fields,
        shipped_keys(),
    ):
        if name in fields:
            return fields[name]
    return None


def _of_another_law(name: str, value: Any, law: Law) -> str:
    """Sentence on a key of a shipped law that the chosen law does not have."""
    keys = ", ".join(law.keys.model_fields) or "none"
    having = ", ".join(n for n in shipped_laws() if name in find(n).keys.model_fields)
    return (
        f"controller.{name} = {shown(value)}: has no effect on controller.law = '{law.name}', "
        f"whose keys are: {keys}. Leave the key out, or choose a law that has it: {having}"
    )


def switch_law(
    data: dict[str, Any], reference: str, folder: Path | None = None, written: bool = False
) -> None:
    """Put another law into a table, and drop what belongs to the old one alone: its digest, and
    keys that the new law does not have. Keys that the old law has by default are dropped as well,
    unless they are `written` in a file. A law's file may be in `folder`. Raises LawError."""
    check_one_file(reference, folder)
    law = resolve(reference, folder)
    digest, old = data.pop("law_digest", None), str(data.get("law", DEFAULT_LAW))
    data["law"] = law
    try:
        of_old = find(resolve(old, folder), digest).keys.model_fields
    except LawError:  # a recording may outlive its law
        of_old = {}
    for key in data.keys() - ControllerTable.model_fields.keys():
        is_default = key in of_old and data[key] == of_old[key].default
        belongs = key in of_old or not of_old
        if belongs and (key not in find(law).keys.model_fields or (is_default and not written)):
            del data[key]
