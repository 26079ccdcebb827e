"""Latencies of messages: the output of `ros2 topic delay`, and the times of an MCAP file."""

import re

from hertzloop.scene.errors import shown
from hertzloop.scene.latency_trace.trace_file import Latencies, TraceFile

_AVERAGE = re.compile(r"average delay:\s*(-?\d+(?:\.\d*)?)\s*")
_WINDOW = re.compile(r"\s*min:.*window:\s*(\d+)\s*")


def is_topic_delay(lines: list[str]) -> bool:
    """Whether lines are the output of `ros2 topic delay`."""
    return any(_AVERAGE.fullmatch(line) for line in lines[:20])


def read_topic_delay(lines: list[str], about: TraceFile) -> Latencies:
    """Return the delays of `ros2 topic delay --window 1`, us: one message a line.

    Raises:
        ValueError: a line is the average of several messages, or does not say of how many.
    """
    about.refuse("ros2 topic delay", "column", "sample", "command", "unit", "thread", "topic")
    averages = [float(found[1]) for found in map(_AVERAGE.fullmatch, lines) if found]
    windows = [int(found[1]) for found in map(_WINDOW.fullmatch, lines) if found]
    if max(windows, default=1) > 1:
        raise ValueError(
            f"a line is the average of {max(windows)} messages, which hides their latencies. "
            "Repeat ros2 topic delay with --window 1"
        )
    if len(windows) != len(averages):
        raise ValueError(
            f"{len(averages)} lines have an average delay and {len(windows)} a window. Give the "
            "whole output"
        )
    return Latencies([1e6 * average for average in averages])


def read_message_times(about: TraceFile) -> Latencies:
    """Return log time less publish time of all messages of a topic in an MCAP file, us.

    Raises:
        ValueError: the topic is not told or not there, or the file does not have both times.
    """
    from mcap.reader import make_reader  # not needed for other traces

    about.refuse("an MCAP file", "column", "sample", "command", "unit", "thread")
    topics, delays_ns = set(), []
    with about.file.open("rb") as stream:
        try:
            reader = make_reader(stream, validate_crcs=True)
            for _, channel, message in reader.iter_messages(log_time_order=False):
                topics.add(channel.topic)
                if channel.topic == about.topic:
                    delays_ns.append(message.log_time - message.publish_time)
        except Exception as error:  # of mcap, struct, lz4 or zstandard
            why = str(error) or type(error).__name__
            raise ValueError(
                f"the file cannot be read to its end ({why}). Repair it with: mcap recover"
            ) from error
    if not delays_ns:
        wanted = "give the topic" if about.topic is None else f"has no topic {shown(about.topic)}"
        raise ValueError(
            f"{wanted}. Use latency_trace = {{ file = ..., topic = ... }} with one of "
            f"{', '.join(sorted(topics)) or 'none'}"
        )
    if not any(delays_ns):
        raise ValueError(
            f"publish time and log time of {about.topic} are equal in all messages: the recorder "
            "did not note when they were published"
        )
    return Latencies([1e-3 * delay for delay in delays_ns])
