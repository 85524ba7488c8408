"""Imports without optional parts: quicker, for this thread alone, and for no longer than asked."""

import subprocess
import sys
import threading

import pytest

from softness_bayes.imports import without


@pytest.fixture
def unseen(tmp_path, monkeypatch):
    """Name of a package that nothing has imported."""
    (tmp_path / "unseen_package.py").write_text("there = True\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield "unseen_package"
    sys.modules.pop("unseen_package", None)


def test_a_package_is_hidden_and_then_there(unseen):
    with without(unseen), pytest.raises(ImportError, match="unseen_package"):
        __import__(unseen)
    assert __import__(unseen).there
    with without(unseen):
        assert __import__(unseen).there  # imported before


def test_other_threads_see_it(unseen):
    found = []
    with without(unseen):
        other = threading.Thread(target=lambda: found.append(__import__(unseen)))
        other.start()
        other.join()
    assert found[0].there


def test_an_error_inside_leaves_nothing_behind(unseen):
    before = [*sys.meta_path]
    with pytest.raises(RuntimeError), without(unseen):
        raise RuntimeError
    assert sys.meta_path == before


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("from softness_bayes import arviz_bridge; arviz_bridge.r_hat([[0.0, 1.0, 2.0, 3.0]] * 2)", "bokeh"),
        ("import softness_bayes.plotting.libraries", "arviz"),
    ],
)
def test_a_run_imports_no_library_that_it_does_not_use(code, absent):
    done = subprocess.run(
        [
            sys.executable,
            "-W",
            "ignore",
            "-c",
            f"import sys; {code}; print({absent!r} in sys.modules, 'pandas' in sys.modules)",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["False", "True"], done.stderr
