"""hertzloop: an impact plant, a force law and a message bus between them, at 1 MHz.

Importing this package decides where compiled kernels are cached. Numba does not notice
when a kernel's callee changes in another file (numba #1833), so the cache folder carries
a digest of all kernel sources.
"""

import hashlib
import os
import sys
import tempfile
from pathlib import Path

__version__ = "0.1.0"

_KERNELS = ("plant", "sensors", "controller", "hertzloop", "studies")


def _kernel_digest() -> str:
    root = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(sys.version.encode())
    for package in _KERNELS:
        for source in sorted((root / package).glob("*kernels.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def kernel_cache() -> Path:
    """Folder of the compiled kernels; NUMBA_CACHE_DIR, if set, is its parent."""
    digest = _kernel_digest()
    given = os.environ.get("NUMBA_CACHE_DIR")
    base = Path(given) if given else Path.home() / ".cache" / "hertzloop"
    folder = base if base.name == digest else base / digest
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ".writable").touch()
    except OSError:
        folder = Path(tempfile.gettempdir()) / f"hertzloop-{os.getuid()}" / digest
        folder.mkdir(parents=True, exist_ok=True)
    return folder


# Matrices here are small: threads of the linear algebra cost more than they give.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["NUMBA_CACHE_DIR"] = str(kernel_cache())
