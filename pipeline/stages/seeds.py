"""Random generators that depend on what an item is, never on who computes it or when."""

from __future__ import annotations

import hashlib

import numpy as np


def item_seed(run_seed: int, *identity: str | int) -> int:
    """Return a 63-bit seed for one item.

    Args:
        run_seed: the ``seed`` of ``params.yaml``.
        identity: stage, object and index of the item, in that order.
    """
    text = "\x1f".join([str(run_seed), *(str(part) for part in identity)])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") >> 1


def item_generator(run_seed: int, *identity: str | int) -> np.random.Generator:
    """Return numpy's PCG64 generator seeded by :func:`item_seed`."""
    return np.random.Generator(np.random.PCG64(item_seed(run_seed, *identity)))
