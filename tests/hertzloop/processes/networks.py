"""Hosts on a network, on one machine: namespaces, each joined by a cable to a switch."""

import itertools
import os
import subprocess
import sys
from contextlib import ExitStack

import pytest

_CABLE, _SWITCH = "cable", "switch"
_NOBODY = "02:00:00:00:00:01"  # the hardware address of no host
_numbers = itertools.count()


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


class Network:
    """Hosts by name."""

    def __init__(self, hosts: list[str]) -> None:
        self._stack, self._started = ExitStack(), list[subprocess.Popen]()
        self._places = {host: place for place, host in enumerate(hosts, start=1)}
        self._name = f"hertzloop-{os.getpid()}-{next(_numbers)}"
        try:
            for place in (0, *self._places.values()):  # the first one holds the switch
                _ip("netns", "add", f"{self._name}-{place}")
                self._stack.callback(_ip, "netns", "del", f"{self._name}-{place}")
            self._within(0, "link", "add", _SWITCH, "type", "bridge")
            self._within(0, "link", "set", _SWITCH, "up")
            for host, place in self._places.items():
                port = ("peer", "name", f"port{place}", "netns", f"{self._name}-0")
                self._within(place, "link", "add", _CABLE, "type", "veth", *port)
                self._within(0, "link", "set", f"port{place}", "master", _SWITCH, "up")
                self._within(place, "addr", "add", f"{self.address(host)}/24", "dev", _CABLE)
                for device in ("lo", _CABLE):
                    self._within(place, "link", "set", device, "up")
        except BaseException:
            self.close()
            raise

    def _within(self, place: int, *words: str) -> None:
        _ip("-n", f"{self._name}-{place}", *words)

    def address(self, host: str) -> str:
        """Where a host is."""
        return f"10.77.0.{self._places[host]}"

    def start(self, host: str, *words: str, **more: object) -> subprocess.Popen:
        """Start a program of Python's on a host."""
        process = subprocess.Popen(
            ["ip", "netns", "exec", f"{self._name}-{self._places[host]}", sys.executable, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            **more,
        )
        self._started.append(process)
        return process

    def cut(self, one: str, other: str) -> None:
        """Let no packet of two hosts reach the other from now on."""
        for host, peer in ((one, other), (other, one)):
            lost = (self.address(peer), "lladdr", _NOBODY, "dev", _CABLE, "nud", "permanent")
            self._within(self._places[host], "neigh", "replace", *lost)

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
        pytest.skip(f"network namespaces are not to be had here: {why}")
