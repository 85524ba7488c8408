"""One experiment in every form that a lab may hold it in: the same numbers, the same draws, and read back the same."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd

from softness_bayes.data import Experiment, fabrics_csv, ratings_csv, read_experiment
from softness_bayes.model.build import build
from softness_bayes.results.request import Request
from softness_bayes.runs.run import walked
from softness_bayes.sampler.sampling import sampled_of
from support.report_runs import OPTIONS, quickly

PEOPLE, CLOTHS, DEPTHS = ["01", "1", "Zoë"], ["Köper", "a b", "x"], [0.98, 1.5, 2.25]
STIFFNESS = dict(zip(CLOTHS, [12.5, 80.25, 410.125], strict=True))
BOOKS = ("book", "two sheets", "wide book")

OF_FILES = ("source", "digest", "notes", "rows", "basis", "rating_column", "n_missing")
"""Fields that say where numbers stood; a table that is written leaves missing ratings out."""


def long() -> pd.DataFrame:
    """Ratings of everybody, one of them missing."""
    random = np.random.default_rng(6)
    rows = [(p, f, d) for p in PEOPLE for f in CLOTHS for d in DEPTHS]
    frame = pd.DataFrame(rows, columns=["participant", "fabric", "indentation_mm"])
    frame["rating"] = random.lognormal(2, 1, len(rows)).round(3)
    frame.loc[5, "rating"] = np.nan
    return frame


def forms(folder: Path) -> dict[str, tuple[object, ...]]:
    """Ratings and fabrics, or a table with both, in every form that can be made here; arguments of the reader."""
    ratings, cloth = long(), pd.DataFrame({"fabric": [*STIFFNESS], "E_fab (kPa)": [*STIFFNESS.values()]})
    wide = ratings.pivot(index="participant", columns=["fabric", "indentation_mm"], values="rating")
    wide = wide.reindex(PEOPLE)[[(f, d) for f in CLOTHS for d in DEPTHS]]
    wide.columns = [f"{f} @ {d * 1000:g} µm" for f, d in wide.columns]
    both = ratings.merge(cloth, on="fabric", how="left", sort=False)
    found: dict[str, tuple[object, ...]] = {
        "frames": (ratings, cloth),
        "one frame": (both,),
        "wide frame": (wide, cloth),
    }
    texts = {
        "comma": (both, {"index": False}),
        "semicolon": (both, {"sep": ";", "decimal": ",", "index": False}),
        "tab": (both, {"sep": "\t", "decimal": ",", "index": False}),
        "UTF-16": (both, {"sep": "\t", "encoding": "utf-16", "index": False}),
        "Latin-1": (both, {"encoding": "latin-1", "index": False}),
        "BOM": (both, {"encoding": "utf-8-sig", "index": False, "lineterminator": "\r\n"}),
    }
    for name, (frame, options) in texts.items():
        frame.to_csv(folder / f"{name}.csv", **options)
        found[name] = (folder / f"{name}.csv",)
    (folder / "wide").mkdir()
    wide.to_csv(folder / "wide" / "ratings.csv", sep=";", decimal=",")
    cloth.to_csv(folder / "wide" / "fabrics.csv", index=False)
    found["wide text"] = (folder / "wide" / "ratings.csv",)
    if find_spec("openpyxl"):
        both.to_excel(folder / "book.xlsx", index=False)
        with pd.ExcelWriter(folder / "two sheets.xlsx") as writer:
            ratings.to_excel(writer, sheet_name="ratings", index=False)
            cloth.to_excel(writer, sheet_name="fabrics", index=False)
        with pd.ExcelWriter(folder / "wide book.xlsx") as writer:
            wide.to_excel(writer, sheet_name="Bewertungen")
            cloth.to_excel(writer, sheet_name="fabrics", index=False)
        found |= {name: (folder / f"{name}.xlsx",) for name in BOOKS}
    if find_spec("pyarrow"):
        both.to_parquet(folder / "Parquet.parquet")
        found["Parquet"] = (folder / "Parquet.parquet",)
    return found


def require_same(one: Experiment, other: Experiment, name: str) -> None:
    """Everything that a model takes from two experiments is equal."""
    for table in ("ratings", "fabrics"):
        first, second = getattr(one, table), getattr(other, table)
        for field in type(first).__dataclass_fields__:
            if field in OF_FILES:
                continue
            np.testing.assert_equal(getattr(first, field), getattr(second, field), err_msg=f"{name}: {table}.{field}")


def draws(experiment: Experiment) -> np.ndarray:
    """Every position of a very short walk."""
    with quickly():
        request = Request().with_options(**OPTIONS | {"max_steps": 4})
        posterior = build(experiment, request.model).posterior
        return sampled_of(walked(experiment, posterior, request, None, None)).chains.coordinates


def test_every_form_of_a_table_gives_the_same_draws_and_reads_back(tmp_path):
    every = forms(tmp_path)
    expected = read_experiment(*every["comma"])
    assert expected.ratings.participants == ("01", "1", "Zoë")
    assert (len(expected.ratings), expected.ratings.n_missing) == (26, 1)
    again = tmp_path / "again.csv"
    for name, form in every.items():
        found = read_experiment(*form)
        require_same(found, expected, name)
        assert found.ratings.n_missing == 1, name
        again.write_text(ratings_csv(found.ratings, found.fabrics), encoding="utf-8", newline="")
        require_same(read_experiment(again), expected, f"{name}, written")
        again.write_text(ratings_csv(found.ratings), encoding="utf-8", newline="")
        (tmp_path / "cloth.csv").write_text(fabrics_csv(found.fabrics), encoding="utf-8", newline="")
        require_same(read_experiment(again, tmp_path / "cloth.csv"), expected, f"{name}, written as two")
    # numbers that are equal give equal draws; two forms that share no code of reading show it
    first, second = (draws(read_experiment(*every[name])) for name in ("semicolon", "wide frame"))
    np.testing.assert_array_equal(first, second)
    changed = replace(expected.ratings, rating=1.001 * expected.ratings.rating)
    assert not np.array_equal(first, draws(expected._replace(ratings=changed)))
