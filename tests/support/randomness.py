"""The random numbers of the tests."""

import os
import zlib

import numpy as np

SEED = int(os.environ.get("SOFTNESS_BAYES_SEED", "20240611"))


def generator_of(test: str) -> np.random.Generator:
    """Return the generator of one test, by its pytest name: the same whichever folder its module is in."""
    path, _, name = test.partition("::")
    return np.random.default_rng([SEED, zlib.crc32(f"tests/{path.rpartition('/')[2]}::{name}".encode())])
