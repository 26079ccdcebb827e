"""Programs run as on other processors: settings of Numba, NumPy, OpenBLAS and the C library.

`native` is the processor that the tests run on. A setting cannot add instructions, so on an old
processor some of them are the same. Each compiles its own kernels, into the usual cache.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterable

import numpy as np

_SIMD = np.show_config(mode="dicts")["SIMD Extensions"]["found"]


def _setting(cpu: str, blas: str, *without: str, **more: str) -> dict[str, str]:
    """Environment of a processor: Numba's name of it, OpenBLAS' one, and what NumPy must not use,
    by the beginning of its names."""
    disabled = " ".join(name for name in _SIMD if name.startswith(without))
    return {
        "NUMBA_CPU_NAME": cpu,
        "NUMBA_CPU_FEATURES": "",
        "OPENBLAS_CORETYPE": blas,
        "NPY_DISABLE_CPU_FEATURES": disabled,
    } | more


_AVX512 = ("X86_V4", "AVX512")
_has_avx512 = any(name.startswith(_AVX512) for name in _SIMD)
PROCESSORS = {
    "native": dict[str, str](),
    "haswell": _setting("haswell", "Haswell", *_AVX512),
    "znver3": _setting("znver3", "Zen", *_AVX512),
    # A process that OpenBLAS starts for instructions that are not there ends at once.
    "x86-64-v3": _setting("x86-64-v3", "SkylakeX" if _has_avx512 else "Haswell"),
    "without FMA": _setting(
        "generic",
        "Prescott",
        "X86_V3",
        *_AVX512,
        GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F",
    ),
    "unoptimised": {"NUMBA_OPT": "1"},
}
FEW = ("native", "haswell", "without FMA")

_RUNS = """
import hashlib, json, sys
import hertzloop
from hertzloop.loop.simulate import simulate
from hertzloop.scene.setup import load

found = {}
for scene, *settings in json.loads(sys.argv[1]):
    run = simulate(load(scene, settings))
    for part in ("truth", "samples", "forces"):
        digest = hashlib.sha256(getattr(run, part).tobytes()).hexdigest()
        found[" ".join((part, scene, *settings))] = digest[:16]
print(json.dumps(found))
"""


def said(processor: str, *words: str) -> str:
    """What `python WORDS` prints on a processor, a name of `PROCESSORS`: a program after "-c", or
    `hertzloop` by "-m". Fails where the program does."""
    environment = {**os.environ, **PROCESSORS[processor]}
    done = subprocess.run(
        [sys.executable, *words], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def run_digests(
    scenes: Iterable[tuple[str, ...]], processors: Iterable[str] = tuple(PROCESSORS)
) -> dict[str, dict[str, str]]:
    """Digests of simulated runs by processor, then by array and scene. A scene is a name or a file,
    and settings as of `--set`."""
    asked = json.dumps(list(scenes))
    return {name: json.loads(said(name, "-c", _RUNS, asked)) for name in processors}
