"""Runs of the variants, each made once in a session."""

import pytest


@pytest.fixture(scope="session")
def variant_run(once):
    """Return the run of a variant by its name."""
    from support.variants import fitted  # imports half of the package

    return lambda name: once(f"variant-{name}", fitted, name)
