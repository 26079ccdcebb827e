"""Runs on several hosts, by certificates and access control: who is let in, and who is not."""

import json
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("cryptography")

from hertzloop.bus.access_control import common_name, secured
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.certificates import CertificateAuthority, in_base64
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from tests.commands import as_options
from tests.elastic_scenes import with_elastic_scenes
from tests.hertzloop.commands import (
    EVENTUALLY_S,
    finish,
    grown_to,
    hertzloop,
    next_line,
    wait_for,
)
from tests.hertzloop.processes.networks import Network, network
from tests.hertzloop.scenes import aluminium_3mm, recorded

pytestmark = [pytest.mark.timeout(600), pytest.mark.full]

INTRUDERS = ("other authority", "other name", "replayed")
SHORT = ["run.duration_s=0.003", "run.accuracy=0.1"]
PATIENT = ["--timeout", "60", "--wait", str(EVENTUALLY_S)]


@pytest.fixture
def hosts():
    made = network([*ROLES, *INTRUDERS])
    yield made
    made.close()


@pytest.fixture
def keys(hosts, tmp_path):
    """What the command writes for these hosts."""
    folder = tmp_path / "keys"
    words = ",".join(f"{role}={hosts.address(role)}" for role in ROLES)
    hertzloop("node", "keys", str(folder), "--hosts", words)
    return folder


def begin(
    hosts: Network,
    keys: Path,
    recording: Path,
    *settings: str,
    patience: list[str] = PATIENT,
    roles: tuple[str, ...] = (RECORDER, CONTROLLER, PLANT),
) -> dict[str, subprocess.Popen]:
    """The commands of the documentation, each on its host; `settings` of the scene."""
    # Shared memory would join processes that are on one machine after all.
    commands = {
        RECORDER: ["--out", str(recording)],
        CONTROLLER: ["--no-shared-memory"],
        PLANT: ["aluminium-3mm", "--no-shared-memory", *as_options(settings)],
    }
    return {
        role: node(hosts, role, keys / f"{role}.json5", *commands[role], *patience)
        for role in roles
    }


def node(hosts: Network, role: str, config: Path, *words: str) -> subprocess.Popen:
    """Start a role on its host."""
    command = ["-m", "hertzloop", "node", role, "--zenoh-config", str(config)]
    return hosts.start(role, *command, *with_elastic_scenes(words))


def end_all(processes: dict[str, subprocess.Popen]) -> dict[str, tuple[int, str]]:
    """Exit code and words of each."""
    return {role: finish(process) for role, process in processes.items()}


def same_as_here(recording: Path, folder: Path) -> None:
    """The samples are those of the same scene within one process."""
    there = read(recording)
    assert not there.problems
    here = recorded(aluminium_3mm(*SHORT), folder / "here.mcap")
    assert first_difference(there, here) is None


def test_three_hosts_by_the_commands_of_the_documentation(hosts, keys, tmp_path):
    recording = tmp_path / "run.mcap"
    for role, (code, err) in end_all(begin(hosts, keys, recording, *SHORT)).items():
        assert code == 0, (role, err)
        assert "connected" not in err, (role, err)  # nobody is taken for a stranger
    same_as_here(recording, tmp_path)


def test_a_cut_link_ends_the_run_with_a_sentence(hosts, keys, tmp_path):
    recording = tmp_path / "run.mcap"
    impatient = ["--timeout", "5", "--wait", str(EVENTUALLY_S)]
    roles = begin(hosts, keys, recording, "run.duration_s=15", patience=impatient)
    wait_for(grown_to(recording, 200_000))
    hosts.cut(PLANT, CONTROLLER)
    ends = end_all(roles)
    assert [code for code, _ in ends.values()] == [1, 1, 1], ends
    assert "controller" in ends[PLANT][1]
    assert "plant" in ends[CONTROLLER][1]
    kept = read(recording)
    assert kept.problems
    assert kept.daq.samples > 0
    assert not [end for end in kept.ends.values() if not end.fault]


class Intruder:
    """A program that wants in, on a host of its own."""

    def __init__(self, hosts: Network, host: str, config: Path) -> None:
        command = ["-m", "tests.hertzloop.processes.intruder", str(config), "hertzloop"]
        self._process = hosts.start(host, *command, stdin=subprocess.PIPE)
        self.says()  # that it has begun

    def says(self) -> dict:
        """The next line of its output."""
        return json.loads(next_line(self._process))

    def result(self) -> dict:
        """What it got, at its end."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.close()
        return json.loads(self._process.stdout.read().splitlines()[-1])


class Paper:
    """An authority that signed what the roles have, and other configurations."""

    def __init__(self, hosts: Network, folder: Path) -> None:
        self.folder, self.authority = folder, CertificateAuthority(2)
        self.endpoints = {
            role: f"tls/{hosts.address(role)}:{7450 + n}" for n, role in enumerate(ROLES)
        }
        self.pairs = {}
        for role in ROLES:
            self.pairs[role] = self.authority.certificate(common_name(role), hosts.address(role))
            made = secured(role, self.endpoints, *self._texts(*self.pairs[role]))
            (folder / f"{role}.json5").write_text(json.dumps(made))

    def _texts(self, certificate: str, key: str) -> list[str]:
        return [in_base64(pem) for pem in (certificate, key, self.authority.pem())]

    def of_intruder(self, host: str, certificate: str, key: str) -> Path:
        """A configuration that reaches everybody, and hinders itself in nothing."""
        made = secured(RECORDER, self.endpoints, *self._texts(certificate, key))
        made["access_control"] = {"enabled": False}
        made["listen"] = {"endpoints": []}
        retry = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2}
        made["connect"] = {"endpoints": list(self.endpoints.values()), "retry": retry}
        file = self.folder / f"{host}.json5"
        file.write_text(json.dumps(made))
        return file


@pytest.fixture
def paper(hosts, tmp_path):
    return Paper(hosts, tmp_path)


def test_nobody_else_hears_or_is_heard(hosts, paper, tmp_path):
    """A certificate of another authority, one of ours for another name, one without its key."""
    certificates = {
        "other authority": CertificateAuthority(2).certificate(common_name(RECORDER), "10.77.0.4"),
        "other name": paper.authority.certificate("stranger", "10.77.0.5"),
        "replayed": (
            paper.pairs[CONTROLLER][0],
            CertificateAuthority(2).certificate("mine", "10.77.0.6")[1],
        ),
    }
    intruders = {
        host: Intruder(hosts, host, paper.of_intruder(host, *pair))
        for host, pair in certificates.items()
    }
    recording = tmp_path / "run.mcap"
    roles = begin(hosts, paper.folder, recording, *SHORT, roles=(CONTROLLER, PLANT))
    assert intruders["other name"].says()["linked"]
    # Without its recorder the run could not begin, so the intruder is there during all of it.
    roles |= begin(hosts, paper.folder, recording, *SHORT, roles=(RECORDER,))
    ends = end_all(roles)
    got = {host: intruder.result() for host, intruder in intruders.items()}
    for role, (code, err) in ends.items():
        assert code == 0, (role, err)
    same_as_here(recording, tmp_path)
    for host, one in got.items():
        assert (one["heard"], one["tokens"]) == ([], []), host
    assert got["other name"]["said"]
    assert [got[host]["links"] for host in ("other authority", "replayed")] == [0, 0]
