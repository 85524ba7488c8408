"""Golden values of all observation models: small tables, and their densities by `oracles.raters`.

`python tests/oracles/make_likelihood_goldens.py` computes the cases that have changed, with `--all` every one (ten
minutes), and writes `likelihood_goldens.json`. Each is computed twice, with grids of other steps and ends; both must
agree to `AGREE`.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
FILE = HERE / "likelihood_goldens.json"
AGREE = 1e-5
"""Largest change of any log density when all steps are halved."""
SAMPLED = 0.05
"""Largest error of the density that is sampled, whose draws are weighted afterwards if that matters."""

LAWS = ("normal", "student", "lapses")
TRUTH = {
    "gamma": 0.6,
    "tau": 0.5,
    "varsigma": 0.3,
    "omega": 0.0,
    "eps": 0.4,
    "nu": 4.0,
    "lapse": 0.08,
    "tau_gamma": 0.0,
    "tau_varsigma": 0.0,
    "gap_2": 0.6,
    "gap_3": 0.5,
    "gap_4": 0.7,
}
NEAR = (
    {},
    {"gamma": 1.3, "tau": 0.8, "varsigma": 1.15, "eps": 0.7, "omega": 1.2, "nu": 1.5, "lapse": 0.6, "tau_gamma": 1.2},
    {"gamma": 0.8, "tau": 1.3, "varsigma": 0.85, "eps": 1.6, "omega": 0.8, "nu": 0.7, "lapse": 1.5, "gap_2": 1.2},
)
"""Factors of the parameters at the points of every case: the truth, and two beside it."""

TWO_FABRICS = {"fabric": [0, 0, 1, 1], "rate": [3.0, 11.0, 0.0, 5.0]}
THREE_FABRICS = {"fabric": [0, 0, 1, 1, 2], "rate": [3.0, 11.0, 0.0, 5.0, 21.0]}
ROWS = {
    "condition": [0, 1, 2, 3, 0, 2, 3, 1, 0, 1, 3, 2, 3, 1],
    "participant": [0, 0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 2],
}
"""Three raters with 5, 3 and 6 ratings of four touches."""
FEW_ROWS = {"condition": [0, 1, 3, 2, 0, 1, 2, 3, 1], "participant": [0, 0, 0, 1, 1, 2, 2, 2, 2]}


def simulated(case, p, seed):
    """Return ratings of a table drawn at a vector of parameters, before any rounding, on the additive scale."""
    rng = np.random.default_rng(seed)
    condition, rater = np.array(case["condition"]), np.array(case["participant"])
    x = np.log(np.array(case["rate"]) + p["eps"])
    drive = case["sign"] * p["gamma"] * (x - x[condition].mean())
    people = rater.max() + 1
    scale, exponent, noise = (
        np.array([p[name]]) * rng.standard_normal(people) for name in ("tau", "tau_gamma", "tau_varsigma")
    )
    felt = drive + p["omega"] * rng.standard_normal(max(case["fabric"]) + 1)[case["fabric"]]
    error = rng.standard_normal(condition.size)
    if case["law"] == "student":
        error /= np.sqrt(rng.chisquare(p["nu"], condition.size) / p["nu"])
    error *= p["varsigma"] * np.exp(noise[rater])
    if case["law"] == "lapses":
        error[rng.random(condition.size) < 1.5 * p["lapse"]] += 1.5
    level = {"magnitude": math.log(20.0), "slider": 0.3, "categories": 0.9}[case["scale"]]
    return level + scale[rater] + np.exp(exponent[rater]) * felt[condition] + error


def rated(scale, law, exact, omega=0.0, seed=1, sign=1, truth=None, table=None, **more):
    """Return a case of magnitude estimates, sliders or categories with simulated ratings.

    Inexact magnitude estimates are whole numbers (here about 5, one of the raters counting in halves), inexact sliders
    have steps of a tenth with both ends.
    """
    table = table or (TWO_FABRICS if omega else THREE_FABRICS) | ROWS
    case = {"kind": scale, "scale": scale, "law": law, "sign": sign, **table, **more}
    p = TRUTH | {"omega": omega} | (truth or {})
    z, rows = simulated(case, p, seed), len(table["condition"])
    rater = np.array(table["participant"])
    step, limit, most = np.zeros(rows), np.zeros(rows), np.full(rows, np.inf)
    case.setdefault("grid", [-9.0, 15.0, 0.06] if scale == "magnitude" else [-11.0, 11.0, 0.06])
    if scale == "magnitude":
        y = np.exp(z)
        if not exact:
            y /= 4.0
            step = np.where(rater == 0, 0.5, 1.0)
            limit = step / 2
            y = np.floor(y / step + 0.5) * step
    elif scale == "slider":
        y, most = 1.0 / (1.0 + np.exp(-z)), np.ones(rows)
        if not exact:
            step, limit, most = np.full(rows, 0.1), np.full(rows, 0.05), np.full(rows, 0.95)
            y = np.floor(y / 0.1 + 0.5) * 0.1
            y = np.where(y < 0.05, 0.0, np.where(y > 0.95, 1.0, y))
    else:
        case["categories"] = 5
        y = 1.0 + (z[:, None] > np.cumsum([0.0, p["gap_2"], p["gap_3"], p["gap_4"]])).sum(axis=1)
    y = np.array(more["y"], float) if "y" in more else y.round(12)
    limits = {"step": step.tolist(), "limit": limit.tolist(), "most": most.tolist()}
    return {**case, "y": y.tolist(), "points": points(p), **{k: more.get(k, v) for k, v in limits.items()}}


def points(p, near=NEAR):
    """Return the parameters at all points of a case."""
    return [{name: value * factors.get(name, 1.0) for name, value in p.items()} for factors in near]


def main_cases():
    """Return the cases of raters who differ by their scale alone, with and without deviations of fabrics."""
    cases = {}
    for omega in (0.0, 0.35):
        suffix = ", omega" if omega else ""
        for k, law in enumerate(LAWS):
            for scale in ("magnitude", "slider"):
                for exact in (True, False):
                    name = f"{scale}, {'exact' if exact else 'rounded'}, {law}{suffix}"
                    sign = -1 if law == "student" else 1
                    cases[name] = rated(scale, law, exact, omega, seed=10 + k, sign=sign)
            cases[f"categories, {law}{suffix}"] = rated("categories", law, False, omega, seed=20 + k)
    return cases


def own_cases():
    """Return the cases of raters with exponents or noise of their own; where several effects add up, on fewer rows."""
    exponent, noise = {"tau_gamma": 0.4}, {"tau_varsigma": 0.4}
    by_exponent = {"differ": ["gamma"], "truth": exponent, "grid": [-8.0, 14.0, 0.09], "nodes": 70}
    by_noise = {"differ": ["varsigma"], "truth": noise, "grid": [-8.0, 14.0, 0.04], "nodes": 50}
    by_both = {"differ": ["gamma", "varsigma"], "truth": exponent | noise, "grid": [-4.0, 10.0, 0.06], "nodes": 56}
    by_both["table"] = THREE_FABRICS | FEW_ROWS
    cases = {}
    for k, more in enumerate((by_exponent, by_noise, by_both)):
        name = "own " + " and ".join(more["differ"])
        for law in LAWS:
            cases[f"magnitude, rounded, {law}, {name}"] = rated("magnitude", law, False, seed=30 + k, **more)
        cases[f"magnitude, exact, normal, {name}"] = rated("magnitude", "normal", True, seed=33 + k, **more)
        if more is not by_both:
            fewer = more | {"grid": [-4.0, 10.0, 0.08], "nodes": 32, "table": TWO_FABRICS | FEW_ROWS}
            cases[f"magnitude, rounded, normal, {name}, omega"] = rated(
                "magnitude", "normal", False, 0.35, seed=36 + k, **fewer
            )
    own = by_exponent | {"grid": [-9.0, 9.0, 0.09]}
    cases["slider, exact, student, own gamma"] = rated("slider", "student", True, seed=39, **own)
    own = by_both | {"grid": [-8.0, 9.0, 0.06], "nodes": 66}
    cases["slider, rounded, normal, own gamma and varsigma"] = rated("slider", "normal", False, seed=38, **own)
    for name, case in cases.items():
        if "omega" in name or " and " in name:
            case["points"] = case["points"][:2]
    return cases


def hard_cases():
    """Return the hard corners of raters who differ by their scale."""
    cases, wide, vague = {}, [-16.0, 22.0, 0.06], {"gamma": 0.3, "varsigma": 0.8}
    zeros = [0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 1.0, 7.0, 5.0, 9.0, 2.0, 4.0, 3.0, 8.0]
    whole = {"step": [1.0] * 14, "limit": [0.5] * 14}
    for law in LAWS:
        cases[f"hard: a rater's zeros, {law}"] = rated(
            "magnitude", law, False, grid=wide, y=zeros, truth=vague, **whole
        )
        ends = [0.9, 0.7, 0.2, 0.5, 0.8, 1.0, 1.0, 1.0, 0.6, 0.8, 0.4, 0.1, 0.5, 0.7]
        cases[f"hard: a rater at a slider's end, {law}"] = rated(
            "slider", law, False, grid=[-12.0, 13.0, 0.06], y=ends, truth=vague
        )
        last = [3.0, 4.0, 1.0, 2.0, 3.0, 2.0, 2.0, 3.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0]
        cases[f"hard: a rater in an end category, {law}"] = rated(
            "categories", law, False, grid=[-14.0, 22.0, 0.06], y=last, truth=vague
        )
        cases[f"hard: zeros only, {law}"] = rated(
            "magnitude", law, False, grid=[-22.0, 12.0, 0.06], y=[0.0] * 14, truth=vague, **whole
        )
        narrow = {"truth": {"varsigma": 0.02, "tau": 0.4, "gamma": 0.3}, "grid": [-9.0, 11.0, 0.008]}
        few = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 1.0, 2.0, 1.0, 1.0, 1.0, 2.0]
        cases[f"hard: intervals wider than the noise, {law}"] = rated("magnitude", law, False, y=few, **whole, **narrow)
        torn = [0.0, 1.0, 1.0, 0.0, 1.0, 0.4, 0.3, 0.6, 0.5, 0.7, 0.4, 0.3, 0.6, 0.7]
        cases[f"hard: contradictory sliders, {law}"] = rated("slider", law, False, grid=[-12.0, 12.0, 0.06], y=torn)
        one = {"condition": [0, 1, 2, 3, 4, 1], "participant": [0] * 6}
        cases[f"hard: one rater, {law}"] = rated("magnitude", law, False, table=THREE_FABRICS | one, seed=51)
        alone = {"condition": [0], "participant": [0], "fabric": [0], "rate": [3.0]}
        cases[f"hard: one row, {law}"] = rated("magnitude", law, False, table=alone, y=[6.0], grid=wide)
        cases[f"hard: one exact row, {law}"] = rated("magnitude", law, True, table=alone, y=[6.0], grid=wide)
    for name in [name for name in cases if name.startswith("hard: one rater")]:
        for p in cases[name]["points"][:2]:
            p["tau"] = 0.0
    far = {"truth": {"nu": 1.5, "varsigma": 0.08}, "grid": [-7.0, 13.0, 0.02]}
    case = rated("magnitude", "student", True, seed=52, **far)
    case["y"][1] *= 400.0
    case["y"][10] /= 30.0
    cases["hard: t far from the data"] = case
    return cases


def closed_cases():
    """Return the cases of kinds with a closed form, or without effects."""
    rows = {"condition": [0, 1, 2, 3, 4, 1, 3, 0, 4, 2], "participant": [0, 0, 0, 0, 1, 1, 1, 2, 2, 2]}
    table = THREE_FABRICS | rows
    rng = np.random.default_rng(60)
    noise = rng.standard_normal(10)
    p = TRUTH | {"omega": 0.3}
    seen = {"scale": "magnitude", "law": "normal", "sign": -1, **table}
    about = np.exp(simulated(seen, p, 61)).tolist()
    cases = {
        "ranks": {"kind": "ranks", "scale": "ranks", "law": "gumbel", "y": [2, 3, 1, 4, 3, 1, 2, 2, 1, 1]},
        "ranks with ties": {"kind": "ranks", "scale": "ranks", "law": "gumbel", "y": [2, 2, 1, 2, 3, 1, 1, 1, 1, 2]},
    }
    for case in cases.values():
        case.update(table, sign=1, lists=rows["participant"])
    for law in ("normal", "lapses"):
        answers = [2, 1, 1, 2, 2, 1, 1, 1, 2, 1]
        lists = [0, 0, 1, 1, 2, 2, 3, 4, 5, 5]
        own = {"kind": "pairs", "scale": "pairs", "law": law, "y": answers, "lists": lists, "sign": 1}
        cases[f"pairs, {law}"] = own | table
    for case in cases.values():
        case["points"] = points(p)
    means = {"kind": "aggregated", "scale": "aggregated", "law": "normal", "y": about, "raters": 9, "sign": -1}
    cases["means of nine raters"] = means | table | {"points": points(p | {"varsigma": 0.9, "tau": 1.5})}
    spreads = [0.5 * math.exp(0.3 * e) for e in noise]
    cases["standard deviations of nine raters"] = {
        "kind": "spreads", "scale": "aggregated", "law": "normal", "y": spreads, "raters": 9, "sign": 1,
        **table, "points": points(p),
    }  # fmt: skip
    scores = {"kind": "standardised", "scale": "standardised", "law": "normal", "y": (0.7 * noise).tolist(), "sign": 1}
    cases["z-scores"] = scores | table | {"points": points(p | {"varsigma": 0.7})}
    loads = {"kind": "load errors", "scale": "magnitude", "law": "normal", "y": about, "sign": -1, **table}
    loads |= {"load_slope": [0.1, 0.15, 0.2, 0.1, 0.12], "load_sd": 0.1, "points": points(p)}
    cases["errors of loads"] = loads
    cases["shared errors of loads"] = loads | {"shared": [0, 1, 0, 1, 0]}
    limits = {"step": [0.0] * 10, "limit": [0.0] * 10, "most": [math.inf] * 10, "grid": [-9.0, 15.0, 0.06]}
    erring = {"kind": "erring loads", "points": points(TRUTH)}
    cases["errors of loads, without approximation"] = loads | limits | erring
    cases["shared errors of loads, without approximation"] = cases["shared errors of loads"] | {"kind": "shared loads"}
    finger_rate = [[2.0, 8.0, 0.0, 3.0, 15.0], table["rate"], [5.0, 14.0, 0.5, 8.0, 30.0]]
    cases["raters' fingers"] = {
        "kind": "fingers", "scale": "magnitude", "law": "normal", "y": about, "sign": -1, **table,
        "finger_rate": finger_rate, "finger_nodes": 3, "points": points(TRUTH | {"tau_b": 0.3}),
    }  # fmt: skip
    weight = np.array([0.5, math.exp(8.0), 0.5])  # at -4, 0 and 4 standard deviations; the ends count half
    cases["raters' fingers"]["finger_weight"] = (weight / weight.sum()).tolist()
    skin = {"b": 8e3, "m": 3.8, "tau_b": 0.3, "tau_m": 0.5, "varsigma_f": 0.2}
    near = ({}, {"b": 1.3, "tau_b": 0.7, "varsigma_f": 1.2}, {"m": 0.9, "tau_m": 1.4, "varsigma_f": 0.8})
    depth = [0.5e-3, 1e-3, 1.5e-3, 2e-3, 0.7e-3, 1.2e-3, 1.9e-3]
    force = [0.02 * math.exp(800.0 * d + 0.2 * e) for d, e in zip(depth, noise, strict=False)]
    cases["forces of a plate"] = {
        "kind": "forces", "scale": "plate-force", "law": "normal", "y": force, "indentation": depth,
        "participant": [0, 0, 0, 1, 1, 2, 2], "radius": 8e-3, "poisson": 0.48, "points": points(skin, near),
    }  # fmt: skip
    return cases


def all_cases():
    """Return all cases by name, without golden values."""
    cases = {**main_cases(), **own_cases(), **closed_cases(), **hard_cases()}
    return {name: case | {"sampled": SAMPLED} for name, case in cases.items()}


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
    kept = json.loads(FILE.read_text()) if FILE.exists() and "--all" not in sys.argv else {}
    made = {}
    for name, case in all_cases().items():
        before = kept.get(name, {})
        if all(before.get(key) == value for key, value in case.items() if key != "sampled"):
            made[name] = case | {"golden": before["golden"]}
            continue
        values, change = golden_values(case)
        print(f"{name}: {values[0]['log_likelihood']:.6f}, changes by {change:.1e}", flush=True)
        if change > AGREE:
            raise SystemExit(f"{name}: the grid is too coarse or too short")
        made[name] = case | {"golden": values}
        FILE.write_text(as_text(made))
    FILE.write_text(as_text(made))


def as_text(cases):
    """Return the file: a line for each field of a case."""
    parts = []
    for name, case in cases.items():
        lines = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in case.items())
        parts.append(f"{json.dumps(name)}: {{\n{lines}\n}}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


if __name__ == "__main__":
    main()
