"""Hosts on a network, on one machine: namespaces, and a thread that carries their packets.

Each host has a TUN device of its own; what it sends, the thread gives to the host that it is
for, late or not at all as the test asks. That needs nothing of the kernel but TUN, while `tc netem`
is a module that many kernels lack.
"""

import ctypes
import fcntl
import heapq
import itertools
import os
import random
import select
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress

import pytest

_NEWNET, _TUNSETIFF, _TUN_WITHOUT_HEADER = 0x40000000, 0x400454CA, 0x1001
_DEVICE, _MTU = "cable", 9000
_numbers = itertools.count()


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


def _tun_within(namespace: str) -> int:
    """A TUN device in a namespace; it lasts as long as this handle. A thread enters, since all of
    its sockets and devices belong there from then on."""
    found: list[int | OSError] = []

    def enter() -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        try:
            with open(f"/run/netns/{namespace}") as there:
                if libc.setns(there.fileno(), _NEWNET):
                    raise OSError(ctypes.get_errno(), "setns")
            handle = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
            name = struct.pack("16sH22x", _DEVICE.encode(), _TUN_WITHOUT_HEADER)
            fcntl.ioctl(handle, _TUNSETIFF, name)
            found.append(handle)
        except OSError as error:
            found.append(error)

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    if isinstance(found[0], OSError):
        raise found[0]
    return found[0]


class Network:
    """Hosts by name; `delay_s` and `loss` (a share) hold for every packet, `cut` for pairs."""

    def __init__(self, hosts: list[str]) -> None:
        self.delay_s, self.loss = 0.0, 0.0
        self.carried, self.lost = 0, 0
        self.cut: set[frozenset[str]] = set()
        self._stack, self._random = ExitStack(), random.Random(1)
        self._started: list[subprocess.Popen] = []
        self._names: dict[str, str] = {}
        self._devices: dict[str, int] = {}
        self._address: dict[bytes, str] = {}
        self._late: list[tuple[float, int, int, bytes]] = []
        try:
            for place, host in enumerate(hosts, start=1):
                self._join(host, f"10.77.0.{place}")
            self._end, end = os.pipe()
            self._stack.callback(os.close, self._end)
            thread = threading.Thread(target=self._carry, daemon=True)
            thread.start()
            self._stack.callback(thread.join)
            self._stack.callback(os.close, end)
        except BaseException:
            self.close()
            raise

    def _join(self, host: str, address: str) -> None:
        name = f"hertzloop-{os.getpid()}-{next(_numbers)}"
        _ip("netns", "add", name)
        self._stack.callback(_ip, "netns", "del", name)
        device = _tun_within(name)
        self._stack.callback(os.close, device)
        _ip("-n", name, "addr", "add", f"{address}/24", "dev", _DEVICE)
        _ip("-n", name, "link", "set", _DEVICE, "up", "mtu", str(_MTU))
        _ip("-n", name, "link", "set", "lo", "up")
        self._names[host], self._devices[host] = name, device
        self._address[socket.inet_aton(address)] = host

    def address(self, host: str) -> str:
        """Where a host is."""
        return next(socket.inet_ntoa(a) for a, name in self._address.items() if name == host)

    def start(self, host: str, *words: str, **more: object) -> subprocess.Popen:
        """Start a program of Python's on a host."""
        process = subprocess.Popen(
            ["ip", "netns", "exec", self._names[host], sys.executable, *words],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more,
        )  # fmt: skip
        self._started.append(process)
        return process

    def _carry(self) -> None:
        owner = {device: host for host, device in self._devices.items()}
        count = itertools.count()
        while True:
            wait_s = max(0.0, self._late[0][0] - time.monotonic()) if self._late else None
            ready, _, _ = select.select([*owner, self._end], [], [], wait_s)
            if self._end in ready:
                return
            for device in ready:
                with suppress(OSError):
                    packet = os.read(device, 65536)
                    to = self._address.get(packet[16:20]) if packet[0] >> 4 == 4 else None
                    if to is None:
                        continue
                    if frozenset((owner[device], to)) in self.cut:
                        continue
                    if self._random.random() < self.loss:
                        self.lost += 1
                        continue
                    due = time.monotonic() + self.delay_s
                    heapq.heappush(self._late, (due, next(count), self._devices[to], packet))
            while self._late and self._late[0][0] <= time.monotonic():
                _, _, device, packet = heapq.heappop(self._late)
                self.carried += 1
                with suppress(OSError):  # a full queue loses packets, as it does elsewhere
                    os.write(device, packet)

    def close(self) -> None:
        """End all hosts, and what still runs there."""
        for process in self._started:
            with process:
                process.kill()  # `ip` has become the program itself
        self._stack.close()


def network(hosts: list[str]) -> Network:
    """A network, or the test is skipped with a sentence."""
    try:
        return Network(hosts)
    except (OSError, subprocess.CalledProcessError) as error:
        why = getattr(error, "stderr", None) or error
        pytest.skip(f"network namespaces with TUN devices are not to be had here: {why}")
