"""The page on real cloth says what the chain gives, where the table of real cloth is at hand."""

from __future__ import annotations

import numpy as np
import pytest

from softness_bayes.tools import real_cloth
from softness_bayes.touch.readings import MENDED
from support.paths import ROOT

PAGE = ROOT / "softness_bayes" / "docs" / "cloth.md"
FILE = "fabric_bending_618_drapetester.csv"


@pytest.fixture(scope="module")
def cloth(shared):
    path = shared / "data" / FILE
    if not path.is_file():
        pytest.skip("the table of real cloth is not beside the project")
    return real_cloth.read_cloth(path)


def test_the_numbers_of_the_page_are_those_of_the_chain(cloth):
    page = PAGE.read_text(encoding="utf-8")
    rows = real_cloth.table_of(cloth)
    for line in real_cloth.lines_of(rows)[2:]:
        assert line in page
    assert page.count("\n| default |") + page.count("\n| in-vivo |") == len(rows)
    modulus = cloth.modulus(MENDED.fabric_modulus) / 1e3
    assert (f"{modulus.min():.2g}", f"{modulus.max():.3g}", f"{np.median(modulus):.2g}") == ("0.34", "266", "14")
    shares = {(row[0], row[1]): row for row in rows}
    assert shares["default", "1 N"][2] == "66 %"
    # the skin of living fingers is never better, and nothing brings half within reach
    within = {key: int(row[5].split()[0].strip("<")) for key, row in shares.items()}
    assert max(within.values()) < 50
    assert max(share for (skin, _), share in within.items() if skin == "in-vivo") == 17
    assert all(within["in-vivo", load] <= within["default", load] for _, load in within)


def test_without_the_file_it_says_so(tmp_path, capsys):
    real_cloth.main([str(tmp_path / FILE)])
    assert "skipped" in capsys.readouterr().out
