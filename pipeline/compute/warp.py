"""NVIDIA Warp, started once per process, quietly, with a cache of compiled kernels that can be written."""

from __future__ import annotations

import os
import sys
import tempfile
from functools import lru_cache
from typing import Any


@lru_cache(maxsize=1)
def warp() -> Any:
    """Import and start Warp without its banner and its remark that there is no CUDA driver."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    with tempfile.TemporaryFile() as said:
        # The remark comes from Warp's native library, so that only the descriptor can be listened to.
        sys.stderr.flush()
        stderr = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            try:
                wp.init()
            except OSError:  # the cache below the home folder cannot be made
                wp.config.kernel_cache_dir = os.path.join(tempfile.gettempdir(), f"warp-{os.getuid()}")
                wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            said.seek(0)
            lines = said.read().decode(errors="replace").splitlines()
            sys.stderr.writelines(f"{line}\n" for line in lines if "CUDA driver" not in line)
    return wp
