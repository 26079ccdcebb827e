"""Ctrl-C while kernels are compiled: the same words and exit code as at any other time."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from numba import config

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")

# LLVM calls Python when it has compiled something; a signal that came meanwhile is heard then.
CALLED = """
from numba.core.codegen import CPUCodeLibrary as Library

compiled = Library._object_compiled_hook

def interrupted_there(cls, module, buffer):
    signal.raise_signal(signal.SIGINT)
    compiled(module, buffer)

Library._object_compiled_hook = classmethod(interrupted_there)
"""
# A reference to something of LLVM's that is to be made, once all is imported.
MADE = """
from llvmlite.binding.ffi import ObjectRef
from hertzloop.processes.signals import leave

made = ObjectRef.__init__

def interrupted_there(self, pointer):
    if signal.getsignal(signal.SIGINT) is not leave:
        signal.raise_signal(signal.SIGINT)
    made(self, pointer)

ObjectRef.__init__ = interrupted_there
"""


@pytest.mark.parametrize("words", [["bench"], ["run", "--out", "a.mcap"]])
@pytest.mark.parametrize("where", [CALLED, MADE], ids=["called", "made"])
def test_an_interrupt_within_llvm_is_not_lost(tmp_path: Path, where: str, words: list[str]) -> None:
    script = f"import signal, sys\n{where}\nfrom hertzloop.__main__ import main\nmain()"
    done = subprocess.run(
        [sys.executable, "-c", script, *words],
        cwd=tmp_path, env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        # Whoever started the tests may have it ignored, as shells do in the background.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert [line for line in done.stderr.splitlines() if "Compiling" not in line] == ["interrupted"]
