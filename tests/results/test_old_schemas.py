"""Results of every schema that there was: each is read, drawn, predicted from and reported; a newer one is refused."""

import lzma
import shutil

import h5py
import pytest

from softness_bayes.results.result import Result
from softness_bayes.results.result_file import SCHEMA
from support.command_line import call, refused
from support.paths import ROOT

KEPT = ROOT / "tests" / "old_results"
LARGEST = 200_000


def unpacked(schema, home):
    """Return the directory of a kept result, whose file is stored compressed."""
    directory = shutil.copytree(KEPT / f"schema_{schema}", home / f"schema {schema}")
    packed = directory / "posterior.nc.xz"
    (directory / "posterior.nc").write_bytes(lzma.decompress(packed.read_bytes()))
    packed.unlink()
    return directory


@pytest.mark.parametrize("schema", range(1, SCHEMA + 1))
def test_a_result_of_every_schema_is_read_drawn_predicted_from_and_reported(schema, tmp_path, few_pictures):
    assert sum(path.stat().st_size for path in (KEPT / f"schema_{schema}").iterdir()) < LARGEST
    directory = unpacked(schema, tmp_path)
    result = Result.load(directory)
    assert result.attributes["schema_version"] == schema
    assert result.verified == (schema > 1)
    assert result.summary().loc["b", "mean"] > 0
    assert result.inflection().loc["2 mm", "p_interior"] <= 1
    done = call("plot", directory, "--figures", "rating", "--format", "png")
    assert (directory / "figures" / "rating.png").stat().st_size > 1000, done.stderr
    (tmp_path / "new.csv").write_text("fabric,effective_modulus_kpa\nfelt,30\nwool,77\n")
    done = call("predict", "--posterior", directory, "--fabrics", tmp_path / "new.csv", "--force-n", "1")
    assert done.returncode == 0, done.stderr
    header, felt, _ = done.stdout.splitlines()
    row = dict(zip(header.split(","), felt.split(","), strict=False))
    assert float(row["typical_rating_low"]) < float(row["typical_rating"]) < float(row["typical_rating_high"])
    done = call("report", directory)
    assert done.returncode == 0, done.stderr
    assert "felt" in (directory / "report.html").read_text(encoding="utf-8")


def test_a_result_of_a_newer_schema_is_refused(tmp_path):
    directory = unpacked(SCHEMA, tmp_path)
    with h5py.File(directory / "posterior.nc", "a") as file:
        file.attrs["schema_version"] = SCHEMA + 1
    for verb in (["report", directory], ["plot", directory], ["target", directory, "--rating", "20"]):
        refused(
            call(*verb, cwd=tmp_path),
            f"schema {SCHEMA + 1} is newer than {SCHEMA}, the latest that this version reads; read it with",
        )
    assert not (directory / "report.html").exists()
