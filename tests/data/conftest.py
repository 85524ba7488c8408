"""What the tests of tables share: files of some text, and how a table is refused."""

import pytest


@pytest.fixture
def file(tmp_path):
    """Write a file of some text or bytes, and return its path."""

    def write(content, name="ratings.csv"):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write
