"""Numbers that are legal and extreme: read or refused by name, without a warning of the libraries beneath."""

import warnings

import pytest

from support.command_line import call

VALUES = ("1e300", "5e-324", "inf")
TABLES = {
    "indentation_mm,rating,tensile_modulus_mpa,thickness_mm,poisson_ratio": ("2,5,3,0.2,0.3", "2,6,4,0.2,0.3"),
    "force_n,rating,effective_modulus_kpa,effective_modulus_cv,load_cv": ("2,5,30,0.1,0.1", "2,6,40,0.1,0.1"),
    "force_n,rating,bending_rigidity_n_m,thickness_mm,thickness_sd_mm,bending_rigidity_sd_n_m": (
        "2,5,1e-5,0.3,0.01,1e-7",
        "2,6,2e-5,0.3,0.01,1e-7",
    ),
    "force_n,rating,effective_modulus_low_kpa,effective_modulus_high_kpa": ("2,5,30,50", "2,6,40,60"),
    "force [kN],rating,effective modulus [GPa]": ("0.002,5,3e-5", "0.002,6,4e-5"),
}


def cases():
    for head, rows in TABLES.items():
        for k, column in enumerate(head.split(",")):
            yield pytest.param(head, rows, k, id=f"{column}-{head.count(',')}")


def write(path, head, rows, k, value):
    """Write a table of two raters with one extreme number for the first fabric."""
    lines = [f"participant,fabric,{head}"]
    for rater in ("P1", "P2"):
        for fabric, row in zip("ab", rows, strict=True):
            cells = row.split(",")
            cells[k] = value if fabric == "a" else cells[k]
            lines.append(",".join([rater, fabric, *cells]))
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(("head", "rows", "k"), [*cases()])
def test_an_extreme_number_is_read_or_refused_by_name(tmp_path, head, rows, k):
    path = tmp_path / "table.csv"
    for value in VALUES[: 2 + (k == 0)]:  # what is infinite is refused in the same way in every column
        write(path, head, rows, k, value)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            done = call("check", "--data", path)
        assert done.returncode in (0, 2), (value, done.stderr)
        if done.returncode:
            assert "table.csv: " in done.stderr, value
            assert "expected" in done.stderr or "error" in done.stderr.partition(": ")[2], (value, done.stderr)
