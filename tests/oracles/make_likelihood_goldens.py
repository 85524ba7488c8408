"""Golden values of all observation models: densities of small tables by `oracles.raters`.

`likelihood_goldens.json` holds the tables, drawn once from the models or written by hand for a hard corner, and the
parameters at which they are evaluated. `python tests/oracles/make_likelihood_goldens.py` computes the values of a case
that has none, which is all that a new case needs; with `--all` those of every case (ten minutes). Each is computed
twice, with grids of other steps and ends; both must agree to `AGREE`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
FILE = HERE / "likelihood_goldens.json"
AGREE = 1e-5
"""Largest change of any log density when all steps are halved."""


def golden_values(case):
    """Return the golden values at each point of a case, and the largest change with other steps."""
    from oracles import raters

    found, largest = [], 0.0
    for k, p in enumerate(case["points"]):
        if case["kind"] in ("erring loads", "shared loads"):  # of interest is the error of the approximation
            found.append({"log_likelihood": float(raters.log_density(case, p))})
            continue
        whole, loo, people = raters.densities(case, p)
        one = {"log_likelihood": float(whole), "loo": np.array(loo).tolist(), "participants": np.array(people).tolist()}
        if case["kind"] in raters.BY_GRIDS:
            own = raters.Posterior(case, p)
            if k == 0:
                one["moments"] = own.moments()
            # the check of the steps: three quarters of them, over wider ranges
            low, high, step = case["grid"]
            nodes = round(case.get("nodes", 41) * 1.25)
            other = case | {"grid": [low - 0.7, high + 0.9, 0.77 * step], "nodes": nodes}
            largest = max(largest, abs(raters.Posterior(other, p).log_density(range(len(case["y"]))) - whole))
        found.append(one)
    return rounded(found), largest


def rounded(values):
    """Return nested lists and dictionaries of numbers with ten digits each."""
    if isinstance(values, dict):
        return {name: rounded(value) for name, value in values.items()}
    return [rounded(value) for value in values] if isinstance(values, list) else float(f"{values:.10g}")


def main():
    """Write the file."""
    sys.path.insert(0, str(HERE.parent))
    cases = json.loads(FILE.read_text())
    for name, case in cases.items():
        if "golden" not in case or "--all" in sys.argv:
            case["golden"], change = golden_values(case)
            print(f"{name}: {case['golden'][0]['log_likelihood']:.6f}, changes by {change:.1e}", flush=True)
            if change > AGREE:
                raise SystemExit(f"{name}: the grid is too coarse or too short")
    FILE.write_text(as_text(cases))


def as_text(cases):
    """Return the file: a line for each field of a case."""
    parts = []
    for name, case in cases.items():
        lines = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in case.items())
        parts.append(f"{json.dumps(name)}: {{\n{lines}\n}}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


if __name__ == "__main__":
    main()
