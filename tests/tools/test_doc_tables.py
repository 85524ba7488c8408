"""Tables of the guide: as the kept results have them, on every page that shows one."""

from __future__ import annotations

import re
import shutil

import pandas as pd
import pytest

from softness_bayes.tools.doc_tables import DOCS, RESULTS, TABLES, filled


@pytest.mark.parametrize("page", sorted({page for page, _ in TABLES}))
def test_page_has_the_kept_results(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    assert filled(page, text) == text, "run python -m softness_bayes.tools.doc_tables"


@pytest.mark.parametrize(("page", "name"), TABLES)
def test_a_changed_result_is_noticed(page, name, tmp_path):
    """Negative control: other kept numbers make another page."""
    shutil.copytree(RESULTS, tmp_path / "results")
    for path in (tmp_path / "results").rglob("*"):
        if path == tmp_path / "results" / "calibration" / "ranks.csv":
            # the last number of a line is a true value, and the last of the first line belongs to a name
            table = pd.read_csv(path)
            table.assign(b=99 - table["b"]).to_csv(path, index=False)
        elif path.suffix in (".csv", ".md", ".txt"):
            text = path.read_text(encoding="utf-8")
            path.write_text(re.sub(r"[1-8](?=[^1-8]*$)", "9", text, flags=re.M), encoding="utf-8")
    made = TABLES[page, name]
    assert made(tmp_path / "results") != made(RESULTS)


def test_every_pair_of_marks_is_filled_in():
    for path in DOCS.glob("*.md"):
        marks = re.findall(r"^<!-- /([a-z-]+) -->$", path.read_text(encoding="utf-8"), flags=re.M)
        assert {(path.name, name) for name in marks} <= TABLES.keys()


def test_a_page_without_its_marks_is_named():
    with pytest.raises(ValueError, match=r"claims\.md.*<!-- claims -->"):
        filled("claims.md", "# The paper's claims\n")
