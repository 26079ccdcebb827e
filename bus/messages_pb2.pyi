import datetime

from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SharedMemoryAnswer(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    NOT_STATED: _ClassVar[SharedMemoryAnswer]
    JOINED: _ClassVar[SharedMemoryAnswer]
    OTHER_HOST: _ClassVar[SharedMemoryAnswer]
    NOT_ALLOWED: _ClassVar[SharedMemoryAnswer]
    SWITCHED_OFF: _ClassVar[SharedMemoryAnswer]

class EventKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    TEXT: _ClassVar[EventKind]
    CONTACT_BEGAN: _ClassVar[EventKind]
    CONTACT_ENDED: _ClassVar[EventKind]
    RANGE_LEFT: _ClassVar[EventKind]
    RANGE_REGAINED: _ClassVar[EventKind]
    LAW_MODE: _ClassVar[EventKind]
    RUN_FAILED: _ClassVar[EventKind]
NOT_STATED: SharedMemoryAnswer
JOINED: SharedMemoryAnswer
OTHER_HOST: SharedMemoryAnswer
NOT_ALLOWED: SharedMemoryAnswer
SWITCHED_OFF: SharedMemoryAnswer
TEXT: EventKind
CONTACT_BEGAN: EventKind
CONTACT_ENDED: EventKind
RANGE_LEFT: EventKind
RANGE_REGAINED: EventKind
LAW_MODE: EventKind
RUN_FAILED: EventKind

class Hello(_message.Message):
    __slots__ = ("run_id", "scene", "scene_toml", "steps", "step_ns", "seed", "stiffness", "versions", "law", "law_digest", "shared_memory", "pace", "repeats")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_FIELD_NUMBER: _ClassVar[int]
    SCENE_TOML_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    STEP_NS_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    STIFFNESS_FIELD_NUMBER: _ClassVar[int]
    VERSIONS_FIELD_NUMBER: _ClassVar[int]
    LAW_FIELD_NUMBER: _ClassVar[int]
    LAW_DIGEST_FIELD_NUMBER: _ClassVar[int]
    SHARED_MEMORY_FIELD_NUMBER: _ClassVar[int]
    PACE_FIELD_NUMBER: _ClassVar[int]
    REPEATS_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    scene: str
    scene_toml: str
    steps: int
    step_ns: int
    seed: int
    stiffness: float
    versions: str
    law: str
    law_digest: str
    shared_memory: SharedMemoryOffer
    pace: float
    repeats: int
    def __init__(self, run_id: _Optional[int] = ..., scene: _Optional[str] = ..., scene_toml: _Optional[str] = ..., steps: _Optional[int] = ..., step_ns: _Optional[int] = ..., seed: _Optional[int] = ..., stiffness: _Optional[float] = ..., versions: _Optional[str] = ..., law: _Optional[str] = ..., law_digest: _Optional[str] = ..., shared_memory: _Optional[_Union[SharedMemoryOffer, _Mapping]] = ..., pace: _Optional[float] = ..., repeats: _Optional[int] = ...) -> None: ...

class LawText(_message.Message):
    __slots__ = ("run_id", "source")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    source: str
    def __init__(self, run_id: _Optional[int] = ..., source: _Optional[str] = ...) -> None: ...

class SceneText(_message.Message):
    __slots__ = ("run_id", "scene_toml")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_TOML_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    scene_toml: str
    def __init__(self, run_id: _Optional[int] = ..., scene_toml: _Optional[str] = ...) -> None: ...

class SharedMemoryOffer(_message.Message):
    __slots__ = ("host", "pid", "fd")
    HOST_FIELD_NUMBER: _ClassVar[int]
    PID_FIELD_NUMBER: _ClassVar[int]
    FD_FIELD_NUMBER: _ClassVar[int]
    host: str
    pid: int
    fd: int
    def __init__(self, host: _Optional[str] = ..., pid: _Optional[int] = ..., fd: _Optional[int] = ...) -> None: ...

class DaqBlock(_message.Message):
    __slots__ = ("run_id", "sequence", "first_step", "step_ns", "every_steps", "scale", "offset", "checksum", "code", "value", "saturated")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    FIRST_STEP_FIELD_NUMBER: _ClassVar[int]
    STEP_NS_FIELD_NUMBER: _ClassVar[int]
    EVERY_STEPS_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    CHECKSUM_FIELD_NUMBER: _ClassVar[int]
    CODE_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    SATURATED_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    sequence: int
    first_step: int
    step_ns: int
    every_steps: int
    scale: float
    offset: float
    checksum: int
    code: _containers.RepeatedScalarFieldContainer[int]
    value: _containers.RepeatedScalarFieldContainer[float]
    saturated: bytes
    def __init__(self, run_id: _Optional[int] = ..., sequence: _Optional[int] = ..., first_step: _Optional[int] = ..., step_ns: _Optional[int] = ..., every_steps: _Optional[int] = ..., scale: _Optional[float] = ..., offset: _Optional[float] = ..., checksum: _Optional[int] = ..., code: _Optional[_Iterable[int]] = ..., value: _Optional[_Iterable[float]] = ..., saturated: _Optional[bytes] = ...) -> None: ...

class ForceBlock(_message.Message):
    __slots__ = ("run_id", "sequence", "first_step", "step_ns", "samples_seen", "zero_until_trigger", "trigger_level", "shared_memory", "checksum", "force_n")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    FIRST_STEP_FIELD_NUMBER: _ClassVar[int]
    STEP_NS_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_SEEN_FIELD_NUMBER: _ClassVar[int]
    ZERO_UNTIL_TRIGGER_FIELD_NUMBER: _ClassVar[int]
    TRIGGER_LEVEL_FIELD_NUMBER: _ClassVar[int]
    SHARED_MEMORY_FIELD_NUMBER: _ClassVar[int]
    CHECKSUM_FIELD_NUMBER: _ClassVar[int]
    FORCE_N_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    sequence: int
    first_step: int
    step_ns: int
    samples_seen: int
    zero_until_trigger: bool
    trigger_level: float
    shared_memory: SharedMemoryAnswer
    checksum: int
    force_n: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, run_id: _Optional[int] = ..., sequence: _Optional[int] = ..., first_step: _Optional[int] = ..., step_ns: _Optional[int] = ..., samples_seen: _Optional[int] = ..., zero_until_trigger: _Optional[bool] = ..., trigger_level: _Optional[float] = ..., shared_memory: _Optional[_Union[SharedMemoryAnswer, str]] = ..., checksum: _Optional[int] = ..., force_n: _Optional[_Iterable[float]] = ...) -> None: ...

class TruthBlock(_message.Message):
    __slots__ = ("run_id", "sequence", "first_step", "step_ns", "xi_m", "xi_s_m", "xi_p_m", "v_p_m_s", "f_c_n", "f_a_n", "xi_a_m", "f_c1_n", "f_a1_n", "deepest_m", "held_steps")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    FIRST_STEP_FIELD_NUMBER: _ClassVar[int]
    STEP_NS_FIELD_NUMBER: _ClassVar[int]
    XI_M_FIELD_NUMBER: _ClassVar[int]
    XI_S_M_FIELD_NUMBER: _ClassVar[int]
    XI_P_M_FIELD_NUMBER: _ClassVar[int]
    V_P_M_S_FIELD_NUMBER: _ClassVar[int]
    F_C_N_FIELD_NUMBER: _ClassVar[int]
    F_A_N_FIELD_NUMBER: _ClassVar[int]
    XI_A_M_FIELD_NUMBER: _ClassVar[int]
    F_C1_N_FIELD_NUMBER: _ClassVar[int]
    F_A1_N_FIELD_NUMBER: _ClassVar[int]
    DEEPEST_M_FIELD_NUMBER: _ClassVar[int]
    HELD_STEPS_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    sequence: int
    first_step: int
    step_ns: int
    xi_m: _containers.RepeatedScalarFieldContainer[float]
    xi_s_m: _containers.RepeatedScalarFieldContainer[float]
    xi_p_m: _containers.RepeatedScalarFieldContainer[float]
    v_p_m_s: _containers.RepeatedScalarFieldContainer[float]
    f_c_n: _containers.RepeatedScalarFieldContainer[float]
    f_a_n: _containers.RepeatedScalarFieldContainer[float]
    xi_a_m: _containers.RepeatedScalarFieldContainer[float]
    f_c1_n: _containers.RepeatedScalarFieldContainer[float]
    f_a1_n: _containers.RepeatedScalarFieldContainer[float]
    deepest_m: _containers.RepeatedScalarFieldContainer[float]
    held_steps: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, run_id: _Optional[int] = ..., sequence: _Optional[int] = ..., first_step: _Optional[int] = ..., step_ns: _Optional[int] = ..., xi_m: _Optional[_Iterable[float]] = ..., xi_s_m: _Optional[_Iterable[float]] = ..., xi_p_m: _Optional[_Iterable[float]] = ..., v_p_m_s: _Optional[_Iterable[float]] = ..., f_c_n: _Optional[_Iterable[float]] = ..., f_a_n: _Optional[_Iterable[float]] = ..., xi_a_m: _Optional[_Iterable[float]] = ..., f_c1_n: _Optional[_Iterable[float]] = ..., f_a1_n: _Optional[_Iterable[float]] = ..., deepest_m: _Optional[_Iterable[float]] = ..., held_steps: _Optional[_Iterable[int]] = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("timestamp", "level", "message", "name", "file", "line", "kind", "number", "quantity", "mode_before", "mode", "delay_ns")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    FILE_FIELD_NUMBER: _ClassVar[int]
    LINE_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    QUANTITY_FIELD_NUMBER: _ClassVar[int]
    MODE_BEFORE_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    DELAY_NS_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    level: int
    message: str
    name: str
    file: str
    line: int
    kind: EventKind
    number: int
    quantity: str
    mode_before: int
    mode: int
    delay_ns: int
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., level: _Optional[int] = ..., message: _Optional[str] = ..., name: _Optional[str] = ..., file: _Optional[str] = ..., line: _Optional[int] = ..., kind: _Optional[_Union[EventKind, str]] = ..., number: _Optional[int] = ..., quantity: _Optional[str] = ..., mode_before: _Optional[int] = ..., mode: _Optional[int] = ..., delay_ns: _Optional[int] = ...) -> None: ...

class EnergyBalance(_message.Message):
    __slots__ = ("run_id", "energy_start_j", "kinetic_j", "gravity_j", "modal_j", "contact_j", "modal_dissipated_j", "contact_dissipated_j", "injected_j", "energy_residual", "momentum_change_n_s", "contact_impulse_n_s", "gravity_impulse_n_s", "momentum_residual", "newton_iterations", "newton_iterations_max", "contact_steps", "frequencies", "frequency_limit_hz", "expected_error", "plastic_dissipated_j", "dent_m", "newton_fallbacks")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    ENERGY_START_J_FIELD_NUMBER: _ClassVar[int]
    KINETIC_J_FIELD_NUMBER: _ClassVar[int]
    GRAVITY_J_FIELD_NUMBER: _ClassVar[int]
    MODAL_J_FIELD_NUMBER: _ClassVar[int]
    CONTACT_J_FIELD_NUMBER: _ClassVar[int]
    MODAL_DISSIPATED_J_FIELD_NUMBER: _ClassVar[int]
    CONTACT_DISSIPATED_J_FIELD_NUMBER: _ClassVar[int]
    INJECTED_J_FIELD_NUMBER: _ClassVar[int]
    ENERGY_RESIDUAL_FIELD_NUMBER: _ClassVar[int]
    MOMENTUM_CHANGE_N_S_FIELD_NUMBER: _ClassVar[int]
    CONTACT_IMPULSE_N_S_FIELD_NUMBER: _ClassVar[int]
    GRAVITY_IMPULSE_N_S_FIELD_NUMBER: _ClassVar[int]
    MOMENTUM_RESIDUAL_FIELD_NUMBER: _ClassVar[int]
    NEWTON_ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    NEWTON_ITERATIONS_MAX_FIELD_NUMBER: _ClassVar[int]
    CONTACT_STEPS_FIELD_NUMBER: _ClassVar[int]
    FREQUENCIES_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_LIMIT_HZ_FIELD_NUMBER: _ClassVar[int]
    EXPECTED_ERROR_FIELD_NUMBER: _ClassVar[int]
    PLASTIC_DISSIPATED_J_FIELD_NUMBER: _ClassVar[int]
    DENT_M_FIELD_NUMBER: _ClassVar[int]
    NEWTON_FALLBACKS_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    energy_start_j: float
    kinetic_j: float
    gravity_j: float
    modal_j: float
    contact_j: float
    modal_dissipated_j: float
    contact_dissipated_j: float
    injected_j: float
    energy_residual: float
    momentum_change_n_s: float
    contact_impulse_n_s: float
    gravity_impulse_n_s: float
    momentum_residual: float
    newton_iterations: int
    newton_iterations_max: int
    contact_steps: int
    frequencies: int
    frequency_limit_hz: float
    expected_error: float
    plastic_dissipated_j: float
    dent_m: float
    newton_fallbacks: int
    def __init__(self, run_id: _Optional[int] = ..., energy_start_j: _Optional[float] = ..., kinetic_j: _Optional[float] = ..., gravity_j: _Optional[float] = ..., modal_j: _Optional[float] = ..., contact_j: _Optional[float] = ..., modal_dissipated_j: _Optional[float] = ..., contact_dissipated_j: _Optional[float] = ..., injected_j: _Optional[float] = ..., energy_residual: _Optional[float] = ..., momentum_change_n_s: _Optional[float] = ..., contact_impulse_n_s: _Optional[float] = ..., gravity_impulse_n_s: _Optional[float] = ..., momentum_residual: _Optional[float] = ..., newton_iterations: _Optional[int] = ..., newton_iterations_max: _Optional[int] = ..., contact_steps: _Optional[int] = ..., frequencies: _Optional[int] = ..., frequency_limit_hz: _Optional[float] = ..., expected_error: _Optional[float] = ..., plastic_dissipated_j: _Optional[float] = ..., dent_m: _Optional[float] = ..., newton_fallbacks: _Optional[int] = ...) -> None: ...

class StreamCount(_message.Message):
    __slots__ = ("stream", "messages", "samples")
    STREAM_FIELD_NUMBER: _ClassVar[int]
    MESSAGES_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    stream: str
    messages: int
    samples: int
    def __init__(self, stream: _Optional[str] = ..., messages: _Optional[int] = ..., samples: _Optional[int] = ...) -> None: ...

class ControllerReport(_message.Message):
    __slots__ = ("scene_toml", "stiffness", "law", "law_digest", "versions")
    SCENE_TOML_FIELD_NUMBER: _ClassVar[int]
    STIFFNESS_FIELD_NUMBER: _ClassVar[int]
    LAW_FIELD_NUMBER: _ClassVar[int]
    LAW_DIGEST_FIELD_NUMBER: _ClassVar[int]
    VERSIONS_FIELD_NUMBER: _ClassVar[int]
    scene_toml: str
    stiffness: float
    law: str
    law_digest: str
    versions: str
    def __init__(self, scene_toml: _Optional[str] = ..., stiffness: _Optional[float] = ..., law: _Optional[str] = ..., law_digest: _Optional[str] = ..., versions: _Optional[str] = ...) -> None: ...

class RunEnd(_message.Message):
    __slots__ = ("run_id", "role", "count", "fault", "report")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    ROLE_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    REPORT_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    role: str
    count: _containers.RepeatedCompositeFieldContainer[StreamCount]
    fault: str
    report: ControllerReport
    def __init__(self, run_id: _Optional[int] = ..., role: _Optional[str] = ..., count: _Optional[_Iterable[_Union[StreamCount, _Mapping]]] = ..., fault: _Optional[str] = ..., report: _Optional[_Union[ControllerReport, _Mapping]] = ...) -> None: ...

class Pacing(_message.Message):
    __slots__ = ("run_id", "pace", "response_max_ns", "late_max_ns", "behind_max_ns", "working_ns", "classes_an_octave", "loop_delay_steps", "step_ns", "answers")
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    PACE_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_MAX_NS_FIELD_NUMBER: _ClassVar[int]
    LATE_MAX_NS_FIELD_NUMBER: _ClassVar[int]
    BEHIND_MAX_NS_FIELD_NUMBER: _ClassVar[int]
    WORKING_NS_FIELD_NUMBER: _ClassVar[int]
    CLASSES_AN_OCTAVE_FIELD_NUMBER: _ClassVar[int]
    LOOP_DELAY_STEPS_FIELD_NUMBER: _ClassVar[int]
    STEP_NS_FIELD_NUMBER: _ClassVar[int]
    ANSWERS_FIELD_NUMBER: _ClassVar[int]
    run_id: int
    pace: float
    response_max_ns: int
    late_max_ns: int
    behind_max_ns: int
    working_ns: int
    classes_an_octave: int
    loop_delay_steps: int
    step_ns: int
    answers: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, run_id: _Optional[int] = ..., pace: _Optional[float] = ..., response_max_ns: _Optional[int] = ..., late_max_ns: _Optional[int] = ..., behind_max_ns: _Optional[int] = ..., working_ns: _Optional[int] = ..., classes_an_octave: _Optional[int] = ..., loop_delay_steps: _Optional[int] = ..., step_ns: _Optional[int] = ..., answers: _Optional[_Iterable[float]] = ...) -> None: ...
