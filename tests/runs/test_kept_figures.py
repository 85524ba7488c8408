"""The formats of a run's figures: no file that was drawn before is left as it was."""

import pytest

from softness_bayes.runs.kept import RUN_FORMATS, _formats


@pytest.mark.parametrize(
    ("there", "more"),
    [([], ()), (["rating.png", "rating.csv"], ()), (["rating.png", "corner.pdf"], ("pdf",)), (["a.svg"], ("svg",))],
)
def test_a_run_draws_anew_what_was_drawn_before(tmp_path, there, more):
    for name in there:
        (tmp_path / name).touch()
    assert _formats(tmp_path) == (*RUN_FORMATS, *more)
    assert _formats(tmp_path / "nowhere") == RUN_FORMATS
