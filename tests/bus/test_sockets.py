"""Endpoints that only their user can reach; ports that are given to nobody else."""

import os
import socket
import tempfile
import time
from pathlib import Path

import pytest

from hertzloop.bus import sockets
from hertzloop.bus.sockets import (
    LOOPBACK,
    own_folder,
    reserved_ports,
    run_folder,
    too_long,
)
from hertzloop.bus.streams import PLANT
from hertzloop.bus.zenoh_port import ZenohPort

KIND = "unixsock-stream/"
LONG_AGO = 3600.0


@pytest.fixture
def temporary(monkeypatch):
    """A short folder for temporary files: that of the tests may be too long for sockets."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        monkeypatch.setattr(tempfile, "tempdir", folder)
        monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
        yield Path(folder)


@pytest.mark.parametrize("runtime", ["set", "unset"])
@pytest.mark.parametrize("name", ["x" * 100, "a#b"])
def test_a_folder_that_cannot_hold_sockets_is_passed_over(temporary, monkeypatch, name, runtime):
    """Its path is too long, or has characters that mean something in an endpoint."""
    unfit = temporary / name
    unfit.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(unfit))
    if runtime != "unset":
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(temporary))
    parent = temporary if runtime == "set" else "/tmp"
    with run_folder() as (_, endpoints):
        assert all(url.startswith(f"{KIND}{parent}/hertzloop-run-") for url in endpoints)
        assert not list(unfit.iterdir())


def test_loopback_where_there_is_no_other_way(temporary, monkeypatch):
    monkeypatch.setattr(sockets, "too_long", lambda _: True)
    with run_folder() as (_, endpoints):
        assert len({url.rpartition(":")[2] for url in endpoints}) == 3
        assert all(url.startswith("tcp/127.0.0.1:") for url in endpoints)


def test_the_longest_path_is_one_that_binds(temporary):
    for length in (107, 108):
        path = f"{temporary}/{'x' * (length - len(str(temporary)) - 1)}"
        assert too_long(KIND + path) == (length > 107)
        try:
            ZenohPort(PLANT, "long", [KIND + path]).close()
            opened = True
        except RuntimeError:
            opened = False
        assert opened == (length <= 107)
    assert not too_long("tcp/" + "x" * 200)


def test_what_a_killed_process_left_goes_with_the_next_run(temporary):
    left, young, other = (
        temporary / f"hertzloop-{name}" for name in ("run-left", "run-young", "other")
    )
    for folder in (left, young, other):
        folder.mkdir()
        (folder / "0").write_text("")
    for folder in (left, other):
        os.utime(folder, (time.time() - LONG_AGO,) * 2)
    with run_folder():
        kept = set(temporary.iterdir())
    assert left not in kept
    assert {young, other} <= kept


def test_the_folder_of_a_long_run_outlives_the_start_of_another(temporary):
    """Its age says that it may be left over; the lock of its maker says that it is not."""
    with own_folder() as folder:
        os.utime(folder, (time.time() - LONG_AGO,) * 2)
        with own_folder() as other:
            assert {str(path) for path in temporary.iterdir()} == {folder, other}
    assert not list(temporary.iterdir())


def test_who_knows_them_listens_on_them_again_and_again():
    with reserved_ports(3) as ports:
        for number in [*ports, *ports]:
            with (
                socket.create_server((LOOPBACK, number)) as server,
                socket.create_connection((LOOPBACK, number)),
            ):
                server.accept()[0].close()


def test_a_port_is_held_once():
    with reserved_ports(2) as one, reserved_ports(2) as other:
        assert not set(one) & set(other)
        for number in one:
            with socket.socket() as asking, pytest.raises(OSError, match="in use"):
                asking.bind((LOOPBACK, number))
