"""Update of the guide's tables from the stored results: ``python -m softness_bayes.tools.doc_tables``.

Run it in a clone after a command has written new results to ``notebooks/results``. On a page, each table is enclosed by
``<!-- name -->`` and ``<!-- /name -->``; only the text between these marks is replaced.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean, median

import numpy as np

import softness_bayes
from softness_bayes.checking.ranks import Calibration
from softness_bayes.readable import percent
from softness_bayes.sampler.workers import AHEAD
from softness_bayes.tools.model_ranks import figure_name
from softness_bayes.tools.rank_agreement import EXPECTED, LONG, SHORT, agreements

PACKAGE = Path(softness_bayes.__file__).parent
DOCS = PACKAGE / "docs"
RESULTS = PACKAGE.parent / "notebooks" / "results"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (head, ["---"] * len(head), *rows))


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def claims(results: Path) -> str:
    """Return the verdicts on the paper's claims, as ``softness-bayes claims`` writes them."""
    return (results / "claims" / "claims.md").read_text(encoding="utf-8")


def bench(results: Path) -> str:
    """Return time and error of the likelihood and of its peers, as ``softness-bayes bench`` writes them."""
    return (results / "bench" / "summary.md").read_text(encoding="utf-8")


def moves(results: Path) -> str:
    """Return the effective draws of each combination of moves and data set, from ``tools.benchmark_moves``."""
    rows = _rows(results / "moves.csv")
    ways, sets = (list(dict.fromkeys(row[key] for row in rows)) for key in ("way", "ratings"))
    cells = {(row["ratings"], row["way"]): _walked(row) for row in rows}
    return table(["ratings", *ways], ([name, *(cells[name, way] for way in ways)] for name in sets))


def _walked(row: Mapping[str, str]) -> str:
    upper, lower = ("< ", "> ") if row["too_short"] == "True" else ("", "")
    return f"{upper}{row['effective_draws_per_second']} ({lower}{row['tau_steps']})"


def samplers(results: Path) -> str:
    """Return whole runs of this and of other samplers on one posterior, from ``tools.benchmark_samplers``."""
    head = ["sampler", "seed", "to its end", "evaluations", "processor time [s]", "effective draws", "per second"]
    head += ["largest shift of a mean [sd]", "ratios of standard deviations"]
    rows = _rows(results / "samplers.csv")
    plain = ["sampler", "seed", "reached_its_end", "evaluations", "processor_s", "effective_draws"]
    plain += ["effective_draws_per_second", "largest_shift_of_a_mean_in_sd"]
    span = ("least_ratio_of_sds", "largest_ratio_of_sds")
    yes = {"True": "yes", "False": "no"}
    cells = ([*(yes.get(row[key], row[key]) for key in plain), " to ".join(row[key] for key in span)] for row in rows)
    return table(head, cells)


def scale(results: Path) -> str:
    """Return time and memory of whole runs on growing tables, from ``tools.benchmark_scale``."""
    rows = _rows(results / "scale.csv")
    head = ["what grows", "size", "ratings", "processor time [s]", "peak memory [MB]", "time as size to the power"]
    head += ["without the constant part"]
    keys = ["kind", "size", "ratings", "processor_s", "peak_mb", "exponent"]
    cells = [[row[key] or "–" for key in keys] + [_power_of_growth(rows, k)] for k, row in enumerate(rows)]
    return f"{table(head, cells)}\nMeasured on: {rows[0]['machine']}.\n"


def _power_of_growth(rows: Sequence[Mapping[str, str]], k: int) -> str:
    """Return p if times grow as a constant plus size^p over three rows of a kind, the last of which is row k."""
    three = rows[max(k - 2, 0) : k + 1]
    if len(three) < 3 or len({row["kind"] for row in three}) > 1:
        return "–"
    times, sizes = (np.diff([float(row[key]) for row in three]) for key in ("processor_s", "size"))
    return f"{np.log(times[1] / times[0]) / np.log(sizes[1] / sizes[0]):.2f}" if (times > 0).all() else "–"


def firing(results: Path) -> str:
    """Return time and error of exact firing rates and of simulators, from ``tools.benchmark_firing``."""
    head = ["method", "setting", "ms per current", "relative error", "time at the same accuracy"]
    rows = _rows(results / "firing.csv")
    keys = ["simulator", "setting", "ms_per_current", "error", "ratio"]
    return f"{table(head, ([row[key] or '–' for key in keys] for row in rows))}\nMeasured on: {rows[0]['machine']}.\n"


def many_parameters(results: Path) -> str:
    """Return the lengths of runs in many dimensions with and without blocks, from ``tools.benchmark_blocks``."""
    head = ["moves", "parameters", "seed", "converged", "autocorrelation time [steps]", "evaluations"]
    return table([*head, "processor time [s]"], (list(row.values()) for row in _rows(results / "many_parameters.csv")))


def versions(results: Path) -> str:
    """Return the speed of the likelihood beside an earlier version's, from ``tools.benchmark_versions``."""
    head = ["channels", "accuracy", "likelihood, old [µs]", "new [µs]", "ratio", "forward model's ratio"]
    head += ["its time over the bare operations", "likelihood over forward model"]
    return table(head, (list(row.values()) for row in _rows(results / "versions.csv")))


def uncertain_cost(results: Path) -> str:
    """Return the costs of runs with uncertain inputs, in those with exact ones, from ``tools.benchmark_uncertain``."""
    folder = results / "uncertain_cost"
    runs, calls = _rows(folder / "runs.csv"), _rows(folder / "calls.csv")
    names, rows = list(dict.fromkeys(row["inputs"] for row in calls)), []
    earlier = next(row["inputs"] for row in runs if row["inputs"] not in names)
    count, spent = (
        {(row["inputs"], row["seed"]): float(row[column]) for row in runs} for column in ("evaluations", "seconds")
    )
    for name in names:
        own = [row for row in runs if row["inputs"] == name]
        more, whole, since = (
            [of[name, row["seed"]] / of[other, row["seed"]] for row in own]
            for of, other in ((count, names[0]), (spent, names[0]), (spent, earlier))
        )
        one = median(float(row["ratio"]) for row in calls if row["inputs"] == name)
        thousands = f"{mean(count[name, row['seed']] for row in own) / 1e3:.0f}"
        ranges = [f"{mean(x):.2f} ({min(x):.2f}–{max(x):.2f})" for x in (more, whole, since)]
        rows.append([name, own[0]["parameters"], str(len(own)), thousands, ranges[0], f"{one:.2f}", *ranges[1:]])
    head = ["inputs", "parameters", "runs", "evaluations [thousands]", "number of evaluations", "time of one"]
    return table([*head, "time of the run", "of that of the earlier version"], rows)


def hard_cases(results: Path) -> str:
    """Return the largest errors of the hard cases, as written by the program in the tests folder."""
    rows = _rows(results / "hard_cases.csv")
    return table(list(rows[0]), (list(row.values()) for row in rows))


def autocorrelation(results: Path) -> str:
    """Return the estimates for walks of known autocorrelation time, from ``tools.benchmark_autocorrelation``."""
    head = ["walks", "estimator", "at 20", "at 50", "at 100", "slowest at 50", "true times at the end", "least"]
    return table(head, (list(row.values()) for row in _rows(results / "autocorrelation.csv")))


def loads(results: Path) -> str:
    """Return the times of compiling and calling scenes of many loads, from ``tools.benchmark_loads``."""
    head = ["kind", "distinct loads", "table", "conditions", "compiled in [s]", "call [ms per vector]", "error / peak"]
    rows = _rows(results / "loads.csv")
    first = {row["kind"]: row for row in reversed(rows)}
    ratios = ["compiling, of that of the first", "call per condition, likewise"]
    return table([*head, *ratios], ([*row.values(), *_ratios(row, first[row["kind"]])] for row in rows))


def _ratios(row: Mapping[str, str], first: Mapping[str, str]) -> list[str]:
    """Return compile and call times of a row relative to the first row of its kind in the same run."""
    compiled = float(row["compile_s"]) / float(first["compile_s"])
    called, least = (float(one["call_ms"]) / float(one["conditions"]) for one in (row, first))
    return [f"{compiled:.1f}", f"{called / least:.1f}"]


def calibration(results: Path) -> str:
    """Return the verdict of the stored calibration, and the coverage of its intervals."""
    rows = _rows(results / "calibration" / "coverage.csv")
    expected = {row["mass"]: float(row["expected"]) for row in rows}
    shares = {(row["quantity"], row["mass"]): float(row["share"]) for row in rows}
    names = dict.fromkeys(row["quantity"] for row in rows)
    head = ["quantity", *(f"{percent(float(mass))} interval" for mass in expected)]
    held = ([f"`{name}`", *(percent(shares[name, mass], 1) for mass in expected)] for name in names)
    exact = ["*expected*", *(f"*{percent(share, 1)}*" for share in expected.values())]
    verdict = (results / "calibration" / "verdict.txt").read_text(encoding="utf-8").strip()
    return f"> {verdict}\n\n{_converged_alone(results)}\n\n{table(head, [*held, exact])}"


def _converged_alone(results: Path) -> str:
    """Return the sentence on the stored replicates without those that have not converged."""
    rows = [row for row in _rows(results / "calibration" / "ranks.csv") if row["converged"] == "True"]
    names = tuple(name.removeprefix("true_") for name in rows[0] if name.startswith("true_"))
    found = Calibration(names, np.array([[int(row[name]) for name in names] for row in rows]))
    least = min(min(one.uniform_p, one.spread_p) for one in found.judge().values())
    says = ", ".join(found.faults()) or "no alarm"
    numbers = f"smallest p-value {least:.2g}, alarm below {found.threshold:.1g}"
    return f"The {len(rows)} converged replicates alone: {says} ({numbers})."


def injected_faults(results: Path) -> str:
    """Return the check that detects each injected fault, as ``tools.injected_faults`` writes it."""
    rows = _rows(results / "injected_faults.csv")
    cells = (
        [row["fault"], row["check"], row["replicates"], row["found"].split("; ")[0], row["seconds"]] for row in rows
    )
    return table(["fault", "check", "replicates", "what it says first", "time [s]"], cells)


def rating_integrals(results: Path) -> str:
    """Return time and error of the integrated likelihoods of ratings, from ``tools.benchmark_ratings``."""
    head = ["ratings, errors", "µs per vector", "over the closed form", "error near the truth", "error over the prior"]
    return table(head, (list(row.values()) for row in _rows(results / "rating_integrals.csv")))


def fabric_errors(results: Path) -> str:
    """Return errors and cost of Laplace's method for fabrics' deviations, from ``tools.fabric_errors``."""
    head = [
        *("ratings, errors, raters", "median near the truth", "standard deviation", "median over the prior", "largest"),
        *("draws of the prior", "cost"),
    ]
    return table(head, (list(row.values()) for row in _rows(results / "fabric_errors.csv")))


def own_errors(results: Path) -> str:
    """Return cost and errors where raters have exponents or noise of their own, from ``tools.own_errors``."""
    head = [
        *("ratings, errors, what differs", "ms per vector", "over raters who are alike", "error near the truth"),
        *("standard deviation", "error within 300", "draws of the prior"),
    ]
    return table(head, (list(row.values()) for row in _rows(results / "own_errors.csv")))


def rank_goal(results: Path) -> str:
    """Return what ranks from simulated walks are like, from ``tools.rank_goal``."""
    head = [
        *("goal", "walks", "autocorrelation times", "replicates", "median steps", "smallest p", "alarm below"),
        *("alarms", "scores spread", "detectable", "time [s]"),
    ]
    return table(head, (list(row.values()) for row in _rows(results / "rank_goal.csv")))


def rank_agreement(results: Path) -> str:
    """Return how far ranks of short replicates are from those of long ones, from two stored calibrations."""
    long, short = (_rows(results / name / "ranks.csv") for name in (LONG, SHORT))
    found = agreements(long, short)
    rows = [[f"`{one.quantity}`", str(one.replicates), f"{one.mean_square:.1f} ± {one.error:.1f}"] for one in found]
    rows.append(["*expected of two sets of independent draws*", "", f"*{EXPECTED:.0f}*"])
    return table(["quantity", "replicates", "mean square of the difference of ranks"], rows)


def tasks(results: Path) -> str:
    """Return the overhead per task, and what it means for very many fits, from ``tools.benchmark_tasks``."""
    rows = _rows(results / "tasks.csv")
    peaks = [name for name in rows[0] if name.startswith("peak_mb_")]
    counts = [int(name.removeprefix("peak_mb_")) for name in peaks]
    head = ["on", "workers", "time per empty task [ms]", "client's processor time [ms]", "scheduler's [ms]"]
    peak = (f"client's peak memory after {count} tasks [MB]" for count in counts)
    head += ["efficiency", "load of the machine", *peak]
    made = table(head, ([cell or "–" for cell in row.values()] for row in rows))
    return f"{made}\n{_on_paper(rows[-1], counts, peaks)}"


def _on_paper(row: Mapping[str, str], counts: Sequence[int], peaks: Sequence[str]) -> str:
    """Return what 100 000 fits cost on a cluster, by the numbers of its row."""
    fits, seconds = 100_000, 60.0
    client, scheduler = float(row["client_ms"]) * 1e-3, float(row["scheduler_ms"]) * 1e-3
    slowest, hours = max(client, scheduler), fits * seconds / 3600
    first = "scheduler" if scheduler >= client else "client"
    growth = float(row[peaks[-1]]) - float(row[peaks[-2]])
    each = growth / (counts[-1] - counts[-2])
    return (
        f"On paper, from the last row: {fits} fits of {seconds:.0f} s of processor time each take {hours:.0f} core "
        f"hours, or {hours / 100:.0f} hours on 100 workers. The client adds {fits * client / 60:.0f} minutes of "
        f"processor time, the scheduler {fits * scheduler / 60:.0f}. The first limit is the {first}: one process "
        f"handles at most {1 / slowest:.0f} tasks per second, so more than about {seconds / slowest:.0f} workers would "
        f"wait for it. At most {AHEAD} tasks are open at a time, but from {counts[-2]} to {counts[-1]} tasks the "
        f"client's peak memory still grew by {growth:.0f} MB, which would be {each * fits / 1000:.1f} GB for {fits}.\n"
    )


def model_ranks(results: Path) -> str:
    """Return the verdicts on every observation model, and on the mistakes in it, from ``tools.model_ranks``."""
    rows = _rows(results / "model_ranks" / "verdicts.csv")
    right = [row for row in rows if row["fit"] == "right"]
    wrong = [row for row in rows if row["fit"] != "right"]
    head = ["model", "laboratories", "k above 0.7", "quantities", "smallest p", "alarm below", "says first"]
    keys = ["model", "labs", "k_large", "quantities", "smallest_p", "alarm_below", "says_first", "width", "shift"]
    linked = [row | {"model": f"[{row['model']}]({_figure_of(row['model'])})"} for row in right]
    own = table([*head, "too narrow by", "shifted by"], ([row[key] for key in keys] for row in linked))
    head = ["model", "mistake in the fit", "laboratories", "smallest p", "says first"]
    keys = ["model", "fit", "labs", "smallest_p", "says_first"]
    return f"{own}\n{table(head, ([row[key] for key in keys] for row in wrong))}"


def _figure_of(model: str) -> str:
    """Return the path of the figure of an observation model's ranks, as seen from the pages."""
    return f"../../notebooks/results/model_ranks/{figure_name(model)}.png"


TABLES: Mapping[tuple[str, str], Callable[[Path], str]] = {
    ("claims.md", "claims"): claims,
    ("benchmarks.md", "bench"): bench,
    ("benchmarks.md", "moves"): moves,
    ("benchmarks.md", "versions"): versions,
    ("benchmarks.md", "scale"): scale,
    ("benchmarks.md", "firing"): firing,
    ("benchmarks.md", "many-parameters"): many_parameters,
    ("benchmarks.md", "samplers"): samplers,
    ("benchmarks.md", "uncertain-cost"): uncertain_cost,
    ("benchmarks.md", "autocorrelation"): autocorrelation,
    ("benchmarks.md", "loads"): loads,
    ("benchmarks.md", "hard-cases"): hard_cases,
    ("model.md", "rating-integrals"): rating_integrals,
    ("model.md", "fabric-errors"): fabric_errors,
    ("model.md", "own-errors"): own_errors,
    ("benchmarks.md", "tasks"): tasks,
    ("calibration.md", "calibration"): calibration,
    ("calibration.md", "model-ranks"): model_ranks,
    ("calibration.md", "injected-faults"): injected_faults,
    ("calibration.md", "rank-goal"): rank_goal,
    ("calibration.md", "rank-agreement"): rank_agreement,
}
"""Function that builds each table, by page and name."""


def filled(page: str, text: str, results: Path = RESULTS) -> str:
    """Return the text of a page with its tables updated from the stored results.

    Parameters
    ----------
    page
        Name of the page's file.
    text
        Its present content.
    results
        Directory of the stored results.

    Raises
    ------
    ValueError
        If the page has no marks for one of its tables.
    """
    for (home, name), made in TABLES.items():
        if home == page:
            begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
            parts = re.split(f"{begin}.*?{end}", text, flags=re.DOTALL)
            if len(parts) != 2:
                raise ValueError(f"{page}: expected {begin} and {end} once, found them {len(parts) - 1} times")
            # some Markdown parsers need an empty line before a table
            text = f"{begin}\n\n{made(results)}\n{end}".join(parts)
    return text


def main() -> None:
    """Fill in the tables of all pages."""
    for page in dict.fromkeys(home for home, _ in TABLES):
        path = DOCS / page
        path.write_text(filled(page, path.read_text(encoding="utf-8")), encoding="utf-8")
        print(f"{path}: written")


if __name__ == "__main__":
    main()
