"""Compare what a recording holds with what plant and controller announced."""

from typing import Any

from hertzloop.bus import sequence_checker, streams
from hertzloop.recordings.file_format import run_metadata
from hertzloop.recordings.run_reader import OTHER_EVENTS, RunReader


def compare_with_hello(found: RunReader) -> None:
    """Report where the hello contradicts scene and description; fill in what the file lacks."""
    hello = found.hello
    if hello is None:
        return
    described, announced_toml = run_metadata(hello), found.announced_toml or hello.scene_toml
    recording = found.recording
    if not recording.scene_toml:
        found.report("the scene is that of the hello: the file has no other")
        recording.scene_toml = announced_toml
    elif recording.scene_toml != announced_toml:
        found.report("the hello has another scene than the file")
    if not recording.metadata:
        found.report("the description of the run is that of the hello")
        recording.metadata = described
    for key in sorted(set(recording.metadata) & set(described)):
        if recording.metadata[key] != described[key]:
            found.report(
                f"{key} is '{recording.metadata[key][:40]}' in the file's description, "
                f"'{described[key][:40]}' in the hello"
            )


def reconcile(found: RunReader) -> None:
    """Report where the counts that the roles announced, or the length of the run, do not fit."""
    recording = found.recording
    for role in (streams.PLANT, streams.CONTROLLER):
        end = recording.ends.get(role)
        if end is None:
            found.report(f"the {role} announced no end: counts cannot be reconciled")
            continue
        announced = {count.stream: count for count in end.count}
        for name, stream in streams.STREAMS.items():
            if stream.publisher == role and not name.startswith("end/"):
                _reconcile_stream(found, role, name, announced.get(name))
    if OTHER_EVENTS in found.counters and len(recording.ends) > 1:
        _reconcile_events(found)
    steps, end_step = _announced_steps(found), recording.truth.end_step
    if end_step < steps:
        found.report(f"readable to step {end_step:,} of {steps:,} announced")
    elif end_step > steps and "steps" in recording.metadata:
        found.report(f"stream 'truth' goes on to step {end_step} of {steps}")


def _reconcile_stream(found: RunReader, role: str, name: str, announced: Any) -> None:
    here = found.counters.get(name, sequence_checker.Counter())
    if name.startswith("events/") and OTHER_EVENTS in found.counters:
        return
    if announced is None:
        if here.messages:
            found.report(f"the {role} announced no count for stream '{name}'")
    elif (here.messages, here.samples) != (announced.messages, announced.samples):
        found.report(
            f"stream '{name}': {here.messages} messages with {here.samples} samples are "
            f"here, {announced.messages} with {announced.samples} were announced"
        )


def _reconcile_events(found: RunReader) -> None:
    """Compare all events together, if some do not say by which role they are."""
    names = [name for name, stream in streams.STREAMS.items() if stream.topic == "/events"]
    counters = (found.counters.get(name) for name in [*names, OTHER_EVENTS])
    here = sum(counter.messages for counter in counters if counter)
    announced = sum(
        count.messages
        for end in found.recording.ends.values()
        for count in end.count
        if count.stream in names
    )
    if here != announced:
        found.report(f"{here} events are here, {announced} were announced")


def _announced_steps(found: RunReader) -> int:
    text = found.recording.metadata.get("steps", "0")
    try:
        steps = int(text)
    except ValueError:
        steps = -1
    if not 0 <= steps <= streams.LAST_NS:
        found.report(f"the length of the run cannot be read: '{text[:40]}'")
        return 0
    return steps
