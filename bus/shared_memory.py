"""The segment of shared memory: made by the plant, joined by the controller."""

import ctypes
import fcntl
import hashlib
import mmap
import os
import stat
from contextlib import suppress
from pathlib import Path

import numpy as np

from hertzloop.bus import messages_pb2 as messages
from hertzloop.bus import ring_kernels
from hertzloop.bus.ring_kernels import (
    ANSWER_WORDS,
    CLOSED,
    EVERY_STEPS,
    JOINED,
    OWN_COUNTS,
    RUN_ID,
    SAMPLE_RING,
    SAMPLE_WORDS,
    SLOTS,
    STEPS,
    VERSION,
)

MAGIC, _VERSION = int.from_bytes(b"hrtzring", "little"), 1
# Some ms of a loop that runs ahead: the other end may be off its core for that long.
_SLOTS = 16_384
_SPINS = 5000  # some 10 us, a few exchanges
# To yield before sleeping is best up to a load of some ten (100 000 exchanges in the usual class at
# load 5: 0.14 to 1.9 s, against 4.5 to 4.8 s with sleeping at once). Where many want the cores it
# gives the turn away (load 16 to 20: 34 s against 9 to 17 s): that is for the real-time class.
_YIELD_NS, WAIT_NS = 1_000_000, 20_000_000
_REST_US = 100
_RARE_NS = 500_000  # ten times what a sleep takes
_SET_TIMER_SLACK, _SLACK_NS = 29, 1_000  # of prctl; 50 us if not set

# 0 on other systems than Linux, where there is no ring either.
_SEALS = sum(getattr(fcntl, f"F_SEAL_{kind}", 0) for kind in ("GROW", "SEAL", "SHRINK"))


def segment_bytes(slots: int) -> int:
    """Size of a segment with `slots` places in each ring."""
    return 8 * (SAMPLE_RING + slots * (SAMPLE_WORDS + ANSWER_WORDS))


def _end(words: np.ndarray, slots: int) -> ring_kernels.Ring:
    """One end of a ring in an array of words."""
    alone = bool(_SEALS) and len(os.sched_getaffinity(0)) == 1
    return ring_kernels.Ring(
        words=words,
        numbers=words.view(np.float64),
        own=np.zeros(OWN_COUNTS, np.int64),
        slots=slots,
        spins=0 if alone else _SPINS,
        yield_ns=_YIELD_NS,
        wait_ns=WAIT_NS,
        rest_us=_REST_US,
    )


def sleep_precisely() -> None:
    """Let the sleeps of this thread, in which the loop runs, end in time."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_SET_TIMER_SLACK, _SLACK_NS)


def at_pace(end: ring_kernels.Ring, sample_ns: float) -> ring_kernels.Ring:
    """This end where a sample comes every so many ns, and is to be answered at once, whatever was
    promised: between rare ones it sleeps soon. One that yields all the time in a real-time class is
    held back by the kernel, for 50 ms of a second."""
    end = end._replace(rest_us=0)
    if sample_ns < _RARE_NS:
        return end
    return end._replace(yield_ns=min(end.yield_ns, int(sample_ns) // 10))


def closed() -> ring_kernels.Ring:
    """The end of a ring that is not there."""
    return _end(np.zeros(SAMPLE_RING, np.int64), 1)


def leave(ring: ring_kernels.Ring) -> None:
    """Tell the other end not to wait any longer."""
    ring.words[CLOSED] = 1


def host() -> str:
    """Digest that is the same for processes that can open each other's segments only."""
    boot = Path("/proc/sys/kernel/random/boot_id").read_bytes()
    names = os.stat("/proc/self/ns/pid").st_ino
    return hashlib.sha256(boot + str(names).encode()).hexdigest()[:16]


class Segment:
    """A segment that the plant offers; `end` is its end of the ring."""

    def __init__(self, run_id: int, steps: int, every_steps: int) -> None:
        """Of a run of `steps` steps with a sample every `every_steps`. Raises OSError where there
        is no such memory."""
        if not _SEALS:
            raise OSError("no sealed memory on this system")
        size = segment_bytes(_SLOTS)
        self.fd = os.memfd_create("hertzloop-ring", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.fchmod(self.fd, 0o600)
            os.ftruncate(self.fd, size)
            fcntl.fcntl(self.fd, fcntl.F_ADD_SEALS, _SEALS)
            words = np.frombuffer(mmap.mmap(self.fd, size), np.int64)
            self._offer = messages.SharedMemoryOffer(host=host(), pid=os.getpid(), fd=self.fd)
        except OSError:
            os.close(self.fd)
            raise
        words[ring_kernels.MAGIC], words[VERSION], words[RUN_ID] = MAGIC, _VERSION, run_id
        words[SLOTS], words[STEPS], words[EVERY_STEPS] = (
            _SLOTS,
            steps,
            every_steps,
        )
        self.end = _end(words, _SLOTS)

    @property
    def offer(self) -> messages.SharedMemoryOffer:
        """What a hello says of it."""
        return self._offer

    def withdraw(self) -> None:
        """Nobody else can open the segment from now on; who has, keeps it."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1


def join(
    hello: messages.Hello, wanted: bool = True
) -> tuple[ring_kernels.Ring | None, messages.SharedMemoryAnswer]:
    """The controller's end of the ring that a hello offers, if any, and the answer to the offer."""
    if not hello.HasField("shared_memory"):
        return None, messages.NOT_STATED
    if not wanted:
        return None, messages.SWITCHED_OFF
    namespace = Path("/proc/self/ns/pid")
    try:
        if not _SEALS or not namespace.exists() or hello.shared_memory.host != host():
            return None, messages.OTHER_HOST
        return _join(hello), messages.JOINED
    except OSError:
        return None, messages.NOT_ALLOWED


def _join(hello: messages.Hello) -> ring_kernels.Ring:
    """Open the ring. Raises OSError, also for what is no ring of this user's run."""
    place = f"/proc/{hello.shared_memory.pid}/fd/{hello.shared_memory.fd}"
    found = os.stat(place)  # before it is opened: opening a device can do something
    if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid() or found.st_nlink:
        raise PermissionError("no ring of this run")
    fd = os.open(place, os.O_RDWR | os.O_CLOEXEC)
    try:
        if fcntl.fcntl(fd, fcntl.F_GET_SEALS) != _SEALS:  # it could shrink under the loop
            raise PermissionError("no ring of this run")
        size = os.fstat(fd).st_size
        if size < segment_bytes(1):
            raise PermissionError("no ring of this run")
        words = np.frombuffer(mmap.mmap(fd, size), np.int64)
    finally:
        os.close(fd)
    slots = int(words[SLOTS])
    known = (words[ring_kernels.MAGIC], words[VERSION], words[RUN_ID]) == (
        MAGIC,
        _VERSION,
        hello.run_id,
    )
    if not known or slots < 1 or slots & (slots - 1) or segment_bytes(slots) != size:
        raise PermissionError("no ring of this run")
    words[JOINED] = hello.run_id
    return _end(words, slots)
