import itertools
import subprocess
import sys

import numpy as np

from pipeline.stages.seeds import item_generator, item_seed


def test_seed_is_the_documented_hash():
    # sha256("1\x1fsynthesize\x1fcube\x1f0"), first 8 bytes, big endian, without the lowest bit: from sha256sum.
    text = b"1\x1fsynthesize\x1fcube\x1f0"
    digest = subprocess.run(["sha256sum"], input=text, capture_output=True, check=True).stdout.decode()
    assert item_seed(1, "synthesize", "cube", 0) == int(digest[:16], 16) >> 1


def test_seeds_of_different_items_differ():
    stages, objects = ("synthesize", "validate", "evaluate"), ("cube", "plum", "cube1", "1cube")
    items = list(itertools.product((0, 1, 11), stages, objects, range(50)))
    assert len({item_seed(*item) for item in items}) == len(items)


def test_identity_is_not_glued_together():
    assert item_seed(1, "ab", "c") != item_seed(1, "a", "bc")
    assert item_seed(1, "a", 12) != item_seed(11, "a", 2)


def test_seed_fits_a_signed_column():
    assert all(0 <= item_seed(seed, "x", seed) < 2**63 for seed in range(200))


def test_generator_is_the_same_in_another_process():
    code = (
        "from pipeline.stages.seeds import item_generator;"
        "print(item_generator(5, 'merge', 'cube', 3).integers(2**62, size=4).tolist())"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert other.strip() == str(item_generator(5, "merge", "cube", 3).integers(2**62, size=4).tolist())


def test_streams_of_neighbours_are_unrelated():
    a, b = (item_generator(1, "synthesize", "cube", i).normal(size=20000) for i in (0, 1))
    assert abs(np.corrcoef(a, b)[0, 1]) < 4 / np.sqrt(20000)  # four standard errors
