"""Growth of whole runs: the kept measurements are linear and bounded, and other rows of the file survive."""

import csv
import math

import pytest

from softness_bayes.bench.scale import TABLES, Grown, Table, grown
from softness_bayes.tools import benchmark_scale
from softness_bayes.tools.benchmark_scale import COLUMNS, main, row
from softness_bayes.tools.doc_tables import scale
from support.paths import ROOT

KEPT = ROOT / "notebooks" / "results" / "scale.csv"


def read(path):
    with path.open(encoding="utf-8", newline="") as file:
        return [*csv.DictReader(file)]


def test_the_kept_runs_are_linear_and_their_memory_is_bounded():
    rows = read(KEPT)
    assert tuple(rows[0]) == COLUMNS
    kept = [(one["kind"], int(one["size"])) for one in rows]
    assert kept == [place for table in TABLES if (place := (table.what, table.size)) in kept]
    # ten times 10 000 ratings, and 10 000 conditions
    assert {("ratings", 102_000), ("conditions", 10_002)} <= {*kept}
    before = None
    for one in rows:
        assert float(one["peak_mb"]) < 4000.0, one
        if before is None or before["kind"] != one["kind"]:
            assert one["exponent"] == ""
        else:
            size, time = (math.log(float(one[key]) / float(before[key])) for key in ("size", "processor_s"))
            assert float(one["exponent"]) == pytest.approx(time / size, abs=0.02)
            assert float(one["exponent"]) <= 1.1, one
        before = one
    powers = [line.split("|")[-2].strip() for line in scale(KEPT.parent).splitlines() if line.startswith("|")][2:]
    assert len(powers) == len(rows)
    assert all(float(power) <= 1.1 for power in powers if power != "–")


def test_the_part_that_does_not_grow_is_left_out_of_the_last_power(tmp_path):
    """Negative control: a small quadratic part beside a large constant."""
    sizes = (10, 100, 1000)
    rows = [row(Grown("loads", n, n, 50.0 + 1e-3 * n**2, 100.0, math.nan), "a machine") for n in sizes]
    with (tmp_path / "scale.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *rows])
    assert scale(tmp_path).splitlines()[4].endswith("| 2.00 |")
    assert "a machine" in scale(tmp_path)


def test_rows_of_other_kinds_are_kept(monkeypatch, tmp_path):
    called = []

    def measured(tables):
        called.extend(table.size for table in tables)
        return iter([Grown(table.what, table.size, 7, 0.5 * table.size, 100.0, math.nan) for table in tables])

    monkeypatch.setattr(benchmark_scale, "grown", measured)
    file = tmp_path / "scale.csv"
    main([str(file), "--kinds", "loads"])
    main([str(file), "--kinds", "ratings"])
    main([str(file), "--kinds", "ratings"])
    rows = read(file)
    assert [one["kind"] for one in rows] == ["ratings"] * 3 + ["loads"] * 3
    assert [one["exponent"] for one in rows] == ["", "1.00", "1.00"] * 2
    called.clear()
    main([str(file), "--kinds", "loads", "predictions", "--missing"])
    assert called == [table.size for table in TABLES if table.what == "predictions"]
    assert read(file)[:6] == rows


def test_a_tiny_table_is_measured():
    (found,) = grown([Table("ratings", 3, 1, 2)])
    assert (found.what, found.size, found.ratings) == ("ratings", 6, 6)
    assert 1.0 < found.seconds < 300.0
    assert 100.0 < found.megabytes < 2000.0
    assert math.isnan(found.exponent)
