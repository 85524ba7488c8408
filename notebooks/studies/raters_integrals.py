"""Times and errors of the integrals over raters' effects: ``python notebooks/studies/raters_integrals.py [FILE.csv]``.

For 30 raters with 36 or 6 ratings each: processor times of the likelihood alone, 64 vectors at a time, and errors of
the total log-likelihood against sums over dense grids (`tests/oracles/raters.py`), at vectors near the truth. Then, for
36 ratings, the time of every observation model over that of the closed form.
"""

import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

TESTS = Path(__file__).resolve().parents[2] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "likelihood")]

from test_golden import likelihood_of, parameters_of, rate_of  # noqa: E402

from oracles import make_likelihood_goldens, raters  # noqa: E402

RATERS, BATCH, NEAR, SECONDS = 30, 64, 12, 0.6
LAWS = ("normal", "student", "lapses")


def table(ratings):
    """Return the design of so many ratings of each rater, of twelve fabrics under three loads, or of six under one."""
    touches = np.arange(ratings)
    return {
        "condition": np.tile(touches, RATERS).tolist(),
        "participant": np.repeat(np.arange(RATERS), ratings).tolist(),
        "fabric": (touches // 3 if ratings > 12 else touches).tolist(),
        "rate": (30.0 * (0.5 + 0.5 * np.sin(1.7 * touches + 0.4)) ** 2).round(3).tolist(),
    }


def near(p, size):
    """Return vectors near a vector of parameters, each value within some per cent."""
    rng = np.random.default_rng(2)
    return {name: value * np.exp(0.04 * rng.standard_normal(size)) for name, value in p.items()}


def microseconds(call):
    """Return the least processor time of a call, each parameter vector [µs]."""
    least, end = np.inf, time.process_time() + SECONDS
    call()
    while time.process_time() < end:
        begun = time.process_time()
        call()
        least = min(least, time.process_time() - begun)
    return 1e6 * least / BATCH


def timed(case, of=lambda observed: observed.for_sampling(), batch=BATCH):
    """Return the time of a likelihood for each vector [µs]."""
    observed = of(likelihood_of(case))
    rate, p = np.tile(rate_of(case), (batch, 1)), parameters_of(observed, near(case["points"][0], batch))
    return microseconds(lambda: observed.log_likelihood(rate, p)) * BATCH / batch


def errors(case, of):
    """Return the largest error of the log-likelihood near the truth, and the standard deviation of the errors."""
    observed, points = of(likelihood_of(case)), near(case["points"][0], NEAR)
    rate = np.tile(rate_of(case), (NEAR, 1))
    found = observed.log_likelihood(rate, parameters_of(observed, points))
    exact = [raters.log_density(case, {name: value[k] for name, value in points.items()}) for k in range(NEAR)]
    return np.abs(found - exact).max(), (found - exact).std()


def integrals():
    """Yield time and errors under each error law, as sampled and as the reference."""
    for ratings in (36, 6):
        for law in LAWS:
            for exact in (True, False):
                grid = {"grid": [-3.0, 8.0, 0.03], "table": table(ratings)}
                case = make_likelihood_goldens.rated("magnitude", law, exact, seed=7, **grid)
                row = {"ratings of each": ratings, "numbers": "exact" if exact else "whole", "errors": law}
                for name, of in (("sampled", lambda y: y.for_sampling()), ("reference", lambda y: y.finer())):
                    row[f"{name} µs"] = round(timed(case, of, BATCH if name == "sampled" else 8), 1)
                    row[f"{name} error"], row[f"{name} sd"] = (float(f"{e:.0e}") for e in errors(case, of))
                yield row


def models():
    """Return tables of every observation model by name, with 36 ratings of each rater."""
    rated, of = make_likelihood_goldens.rated, {"table": table(36)}
    own = {"gamma": {"tau_gamma": 0.25}, "varsigma": {"tau_varsigma": 0.25}}
    own["gamma and varsigma"] = own["gamma"] | own["varsigma"]
    cases = {"exact, normal (closed form)": rated("magnitude", "normal", True, **of)}
    cases["exact, normal, omega (closed form)"] = rated("magnitude", "normal", True, 0.3, **of)
    for law in LAWS:
        for omega in (0.0, 0.3):
            more = ", omega" if omega else ""
            if law != "normal":
                cases[f"exact, {law}{more}"] = rated("magnitude", law, True, omega, **of)
            cases[f"whole, {law}{more}"] = rated("magnitude", law, False, omega, **of)
            cases[f"slider in tenths, {law}{more}"] = rated("slider", law, False, omega, **of)
            cases[f"categories, {law}{more}"] = rated("categories", law, False, omega, **of)
    for names, spreads in own.items():
        more = {"differ": names.split(" and "), "truth": spreads, **of}
        cases[f"exact, normal, own {names}"] = rated("magnitude", "normal", True, **more)
        for law in LAWS:
            cases[f"whole, {law}, own {names}"] = rated("magnitude", law, False, **more)
    magnitude = cases["exact, normal, omega (closed form)"]
    loads = magnitude | {"kind": "load errors", "load_slope": [0.1] * 36, "load_sd": 0.1}
    cases["errors of loads"] = loads
    cases["shared errors of loads"] = loads | {"shared": (np.arange(36) % 3).tolist()}
    places = {"kind": "ranks", "scale": "ranks", "law": "gumbel"}
    places["lists"] = (np.arange(36 * RATERS) // 12).tolist()
    ranks = np.argsort(np.argsort(np.reshape(magnitude["y"], (-1, 12)))).ravel() + 1.0
    cases["ranks in lists of 12"] = magnitude | places | {"y": ranks.tolist()}
    pairs = {"kind": "pairs", "scale": "pairs", "lists": (np.arange(36 * RATERS) // 2).tolist()}
    pairs["y"] = (np.argsort(np.argsort(np.reshape(magnitude["y"], (-1, 2)))).ravel() + 1.0).tolist()
    cases["pairs"] = magnitude | pairs
    return cases


def ratios():
    """Yield the time of every observation model, and its ratio to that of the closed form just before."""
    cases = models()
    closed = cases["exact, normal (closed form)"]
    for name, case in cases.items():
        base, own = timed(closed), timed(case, batch=BATCH if "own" not in name and "omega" not in name else 16)
        yield {"model": name, "µs": round(own, 1), "over the closed form": round(own / base, 1)}


def main():
    """Print both tables, and write them to a file if one is named."""
    with threadpool_limits(1):
        tables = [pd.DataFrame(integrals()), pd.DataFrame(ratios())]
    for one in tables:
        print(one.to_string(index=False), flush=True)
    if sys.argv[1:]:
        pd.concat(tables).to_csv(sys.argv[1], index=False)


if __name__ == "__main__":
    main()
