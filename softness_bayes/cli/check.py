"""`softness-bayes check`: validation of data files, and what was understood of them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softness_bayes.base.defaults import MOST_SHOWN
from softness_bayes.base.errors import InputError
from softness_bayes.base.readable import counted, percent
from softness_bayes.cli.options import Force, command
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_options import DataFiles

if TYPE_CHECKING:
    from softness_bayes.data import Experiment, Measurements, Ratings
    from softness_bayes.model.build import ExperimentModel
    from softness_bayes.model.interpretation import Interpretation
    from softness_bayes.people.free_means import FreeMeans
    from softness_bayes.touch.accuracy import Errors

SPREADS = frozenset({"tau", "varsigma", "omega", "tau_b", "tau_m", "varsigma_f"})
"""Standard deviations of participants, fabrics and ratings, which are estimated better with more of each."""

TOUCHES = "Which touches would tell most? 'softness-bayes design' with these tables; after a run, with --given DIR."

BATCH, STEPS = 64, 20
"""Parameter vectors of a call whose time is measured, and steps of as many walkers."""

MOST_OTHERS, MOST_ROWS = 6, 40
"""Largest numbers of alternative designs that are listed, and of rows of people's means that are shown."""


@command
def check(
    *,
    files: DataFiles,
    model: ModelOptions,
    design: bool = False,
    cost: bool = False,
    json_: bool = False,
    figure: Path | None = None,
    force: Force = False,
) -> None:
    """Validate data files and show how they are read, how precise the design is and what a run costs.

    The table of ratings has one row per rating: participant, fabric, rating, and indentation_mm or force_n; trial, if
    any. Fabrics have one row each in a separate table, or are columns of the ratings: fabric, and
    effective_modulus_kpa, or bending_rigidity_n_m, or tensile_modulus_mpa and thickness_mm; poisson_ratio where
    known. Compression data have one row per force of a rigid flat plate: participant, indentation_mm, force_n;
    indentor, if the rows of other indentors are to be left out. Recorded afferents have one row per response: force_n
    or indentation_mm, probe_curvature_per_m, distance_mm, and rate_hz or count with window_s. Errors name file, row,
    column and value. E_fab is shown under the chosen reading. For ratings, `check` also reports whether they rise or
    fall with stiffness. With --design it predicts in some seconds, before any sampling, how precisely every parameter
    will be known.

    With --cost, errors are the largest over draws of the prior and conditions: of the response, relative to the peak
    of each draw, and of log(N/N_ref + eps). Costs are the time per parameter vector in batches of 64, measured on this
    machine.

    Parameters
    ----------
    design
        Predict how precise the design is: expected posterior widths, and the changes that would help most.
    cost
        Show how 'sample' would evaluate the model with the same options: stages, nodes, errors and cost.
    json_
        Print all of it as JSON instead of text.
    figure
        Draw data and fabrics beside the response that the prior predicts (.png, .pdf or .svg).
    """
    from softness_bayes.data import Measurements
    from softness_bayes.experiments.understanding import SCHEMA, foreseen, understood, understood_measurements, warnings
    from softness_bayes.model.build import ExperimentModel, recorded_terms
    from softness_bayes.model.reach import reach_of
    from softness_bayes.people.free_means import FreeMeans

    if cost and json_:
        raise InputError("check: --cost is printed as text: omit --json")
    if figure is not None:
        _require_figure(figure, files, force)
    experiment = _read_or_answered(files, model, json_)
    if experiment is None:
        return
    recorded_terms(experiment, model)  # raises where a hollow is narrower than the finger
    if isinstance(experiment, Measurements):
        if design or cost or figure is not None:
            raise InputError("check: --design, --cost and --figure need ratings: give --data, or omit them")
        known: dict[str, Any] = {"schema": SCHEMA, **understood_measurements(experiment)}
        known["notes"] = list(experiment.notes)
        _echo(known if json_ else [*measurement_lines(experiment), *(f"note: {note}" for note in known["notes"])])
        return
    made = ExperimentModel(experiment, model)
    reached = reach_of(made)
    notes = [*experiment.notes, *warnings(made)]
    people = None if model.scale.model is not None else FreeMeans(experiment.ratings, model, made.interpretation)
    known = understood(made, [*([reached] if reached else []), *notes])
    known["design"] = foreseen(experiment, model) if design else None
    if json_:
        _echo(known if people is None else known | {"people": _records(people)})
    else:
        lines = []
        if people is not None:
            moduli = [one["e_fab_kpa"] for one in known["fabrics"]]
            lines = [
                *people_lines(people),
                *pair_lines(experiment.ratings, moduli, model.fixed.get("guess")),
                "",
            ]
        lines += [f"warning: {reached}\n"] if reached else []
        lines += [*table_lines(known, experiment, model), *(f"note: {note}" for note in notes)]
        lines += ["\nWhat do the numbers say?", known["model"]["numbers"], known["model"]["errors_because"]]
        lines += ["\nDo ratings rise or fall with stiffness?", *known["model"]["direction_because"]]
        lines += ["", *cost_lines(made)] if cost else []
        lines += ["", *design_lines(known["design"]), TOUCHES] if design else []
        _echo(lines)
    if figure is not None:
        _draw(figure, experiment, model, made.interpretation)
        click.echo(f"drawn in {figure}", err=True)


def _echo(said: dict[str, Any] | list[str]) -> None:
    click.echo(json.dumps(said, indent=1, ensure_ascii=False) if isinstance(said, dict) else "\n".join(said))


def _records(people: FreeMeans) -> list[dict[Any, Any]]:
    """Return what people say of each fabric under each load, None where there is no number."""
    means = people.table().astype(object)
    return means.where(means.notna(), None).to_dict("records")


def _read_or_answered(files: DataFiles, model: ModelOptions, json_: bool) -> Experiment | Measurements | None:
    """Return the data of an experiment; of ratings whose fabrics nobody measured, show people's answer instead."""
    from softness_bayes.experiments.understanding import SCHEMA
    from softness_bayes.people.free_means import FreeMeans
    from softness_bayes.people.sentences import needed_sentences

    try:
        return files.read()
    except InputError as error:
        try:
            ratings = files.answers()
        except InputError:
            raise error from None
        if ratings is None:
            raise
    people = FreeMeans(ratings, model)
    needed = needed_sentences(ratings.fabrics, bool(ratings.loads))
    if json_:
        told = {"people": _records(people), "needed": needed, "notes": [*ratings.notes]}
        _echo({"schema": SCHEMA, "source": ratings.source, **told})
        return None
    for note in ratings.notes:
        click.echo(f"note: {note}", err=True)
    _echo([*people_lines(people), "", *needed])
    return None


def _require_figure(figure: Path, files: DataFiles, force: bool) -> None:
    from softness_bayes.base.files.outputs import require_outputs
    from softness_bayes.plotting.style import METADATA

    if figure.suffix.lstrip(".") not in METADATA:
        known = ", ".join(f".{name}" for name in METADATA)
        raise InputError(f"--figure {figure}: expected a name that ends in one of {known}")
    require_outputs(figure.parent, [figure.name], "check", force, files.paths)


def _draw(figure: Path, experiment: Experiment, model: ModelOptions, meaning: Interpretation) -> None:
    """Draw data and fabrics with the response predicted by draws of the prior."""
    import numpy as np

    from softness_bayes.base.files.outputs import write_outputs
    from softness_bayes.experiments.understanding import prior_responses
    from softness_bayes.plotting.rating import design_figure, observed_ratings
    from softness_bayes.plotting.style import files_of
    from softness_bayes.touch.load_groups import groups_of

    ratings = experiment.ratings
    groups = groups_of(ratings.loads)
    grid, response, modulus = prior_responses(experiment, model, groups.at.tolist(), 200)
    pairs, of_rating = np.unique(groups.of[ratings.load] * len(ratings.fabrics) + ratings.fabric, return_inverse=True)
    load, fabric = np.divmod(pairs, len(ratings.fabrics))
    observed = observed_ratings(
        meaning.intervals.values, of_rating, ratings.participant, modulus[fabric], load, scale=model.scale
    )
    drawn = design_figure(grid, response, observed, groups, scale=model.scale)
    suffix = figure.suffix.lstrip(".")
    write_outputs(figure.parent, files_of(drawn, figure.stem, (suffix,)), "check")


def design_lines(expected: dict[str, Any]) -> list[str]:
    """Return the result of `experiments.understanding.foreseen` as lines of text."""
    lines = [
        "How precise is this design?",
        f"Expected posterior sd / prior sd at {expected['truths']} true values from the prior: median (10 % to 90 "
        "% quantile).",
        "Linear approximation, without sampling. In test runs, 61 of 64 posterior widths were within a factor "
        "of 1.5 of it.",
    ]
    count, used = expected["loads"]
    if used < count:
        lines.append(f"Neighbouring loads among the {count} are merged into {used} for this prediction.")
    for name, (low, middle, high) in expected["sd_ratio"].items():
        lines.append(f"  {name:14} {middle:.2f} ({low:.2f} to {high:.2f})")
    if expected["not_foreseen"]:
        lines.append(f"  not covered: {', '.join(expected['not_foreseen'])}")
    lines += [f"  {_place(place, expected['truths'])}" for place in expected["turning_points"]]
    lines.append("Which changes would help most? (information gained, and the sd ratio that falls most, now and then)")
    for other in expected["others"][:MOST_OTHERS]:
        lines.append(
            f"  {other['design']} ({other['further_ratings']} ratings more): {other['bits']:+.1f} bits; "
            f"{_most(expected['sd_ratio'], other['sd_ratio'])}"
        )
    return lines


def _place(place: dict[str, Any], truths: int) -> str:
    share = f"the response turns over in {percent(place['prior_share'])} of prior draws"
    if place["factor_90"] is None:
        return f"turning point at {place['load']}: precision not predicted; {share}"
    low, middle, high = place["factor_90"]
    found = f"if there is one ({place['truths']} of {truths} true values)"
    return (
        f"turning point at {place['load']}: E_fab known to a factor of {middle:.2f} ({low:.2f} to {high:.2f}), "
        f"posterior sd {place['sd_ratio'][1]:.2f} of the prior sd, {found}; {share}"
    )


def _most(now: dict[str, list[float]], other: dict[str, list[float]]) -> str:
    """Return the parameter whose median ratio falls most, spreads of people and ratings aside, with both ratios."""
    name = min(now.keys() - SPREADS, key=lambda one: (other[one][1] / now[one][1], one))
    if other[name][1] > 0.95 * now[name][1]:
        return "no ratio falls by more than 5 %"
    return f"{name} {now[name][1]:.2f} to {other[name][1]:.2f}"


def cost_lines(model: ExperimentModel) -> list[str]:
    """Return how a run evaluates its model: stages, nodes, errors and cost, and the alternatives.

    Errors are the largest over draws of the prior and conditions: of the response, relative to the peak of each draw,
    and of log(N/N_ref + eps). Costs are the time per parameter vector in batches of 64, measured on this machine; those
    of presets are without the likelihood. A run's time follows from steps of ensembles, whose batches are smaller.
    """
    import numpy as np
    import pandas as pd

    from softness_bayes.bench.precision import quickest
    from softness_bayes.model.scenes import prior_draws
    from softness_bayes.sampler.adaptation import TriangularMap
    from softness_bayes.sampler.chains import EnsembleState, random_state
    from softness_bayes.sampler.ensembles import advance
    from softness_bayes.sampler.sampling import Settings
    from softness_bayes.sampler.workers import available_processors, one_thread
    from softness_bayes.touch.accuracy import DRAWS, PRESETS, first, measured
    from softness_bayes.touch.neuron.fixed_channels import FixedChannels

    scene, chosen, posterior, settings = model.scene, model.resolution, model.posterior, Settings()
    assert chosen is not None, "the command line sets an accuracy"
    rng, draws = np.random.default_rng(0), prior_draws(posterior.space)
    middle, some = np.median(posterior.draw_start(rng, 500), axis=0), first(draws.parameters, BATCH)
    points = middle + 0.2 * rng.standard_normal((BATCH, middle.size))
    plain = TriangularMap.identity(middle.size)
    target = posterior.for_sampling
    begun = [EnsembleState(points, target(points), random_state(np.random.RandomState(0)))] * settings.together
    with one_thread():
        cost = quickest(partial(target, points), 3) / BATCH
        walked = partial(advance, target, begun, STEPS, settings.first_moves, plain)
        moved = quickest(walked, 3) / (STEPS * len(begun) * BATCH)
        each = [measured(scene.recompiled(discretisation=preset), draws) for preset in PRESETS]
        ladder = [(one, quickest(partial(one.scene.total_rate, some), 3) / BATCH) for one in each]
    usual = settings.usual_evaluations(middle.size)
    cores = min(settings.ensembles, available_processors())
    d = chosen.discretisation
    terms = {one: "all terms" if one.rate_terms is None else f"{one.rate_terms} terms" for one in (d, *PRESETS)}
    fixed = isinstance(scene.firing, FixedChannels)
    rates = f"{f'curve through {d.rate_nodes} rates' if fixed else 'surface'}, {terms[d]}"
    mechanics = f"{d.nodes} nodes to exp(-{d.saturation:g}), tolerance {d.field_tolerance:.0e}"
    stages = [
        {"stage": "mechanics", "resolution": mechanics, **_shown(chosen.mechanics)},
        {"stage": "firing rates", "resolution": rates, **_shown(chosen.firing)},
        {"stage": "sum", "resolution": "", **_shown(chosen.errors)},
    ]
    presets = [
        {
            "nodes": one.discretisation.nodes,
            "to exp(-x)": one.discretisation.saturation,
            "tolerance": f"{one.discretisation.field_tolerance:.0e}",
            "rates": terms[one.discretisation],
            **_shown(one.errors),
            "cost [µs]": f"{1e6 * taken:.1f}",
            "": "<- chosen" if one.discretisation.nodes == d.nodes else "",
        }
        for one, taken in ladder
    ]
    return [
        f"accuracy {model.options.accuracy:g}, {scene.n_conditions} conditions, errors over {DRAWS} draws of the prior",
        f"\n{pd.DataFrame(stages).to_string(index=False)}",
        f"\ncost: {1e6 * cost:.1f} µs for the posterior of each parameter vector, {BATCH} at a time, on one core, "
        f"and {1e6 * moved:.1f} µs in steps of a run",
        f"usual run: {usual} vectors, {moved * usual / cores:.3g} s of sampling on {counted(cores, 'processor')}; "
        "thin or bent posteriors, such as of brackets, take up to 20 times as many",
        f"\npresets:\n{pd.DataFrame(presets).to_string(index=False)}",
    ]


def _shown(errors: Errors) -> dict[str, str]:
    return {"error / peak": f"{float(errors.peak):.1e}", "error of log": f"{float(errors.log):.1e}"}


def pair_lines(ratings: Ratings, modulus: Sequence[float], guess: float | None) -> list[str]:
    """Return thresholds of pairs with a reference, for E_fab [kPa] and a known guess rate if given, and cautions."""
    if not ratings.paired:
        return []
    import numpy as np

    from softness_bayes.people.psychometric import comparison_cautions, psychometric_table, threshold_sentences

    found = psychometric_table(ratings, np.array(modulus, float), guess=guess)
    return [*threshold_sentences(found), *(f"caution: {said}" for said in comparison_cautions(ratings))]


def people_lines(found: FreeMeans) -> list[str]:
    """Return people's own means, and what is decided by them."""
    from softness_bayes.base.readable import chance
    from softness_bayes.people.sentences import highest_sentences, pairs_sentence

    table = found.table()
    lines = ["What do people say? (means of these raters, without skin and receptors; 90 % intervals)"]
    lines += highest_sentences(table, found.word, found.scale)
    lines += filter(None, [pairs_sentence(found.loads, found.p_orders)])
    if len(table) <= MOST_ROWS:
        shown = table if any(found.loads) else table.drop(columns="load")
        words = dict.fromkeys(("p_highest", "p_higher_than_next"), chance)
        lines.append(shown.to_string(index=False, float_format="{:.3g}".format, na_rep="–", formatters=words))
    return lines


def table_lines(known: dict[str, Any], experiment: Experiment, model: ModelOptions) -> Iterator[str]:
    """Yield lines on ratings, participants, fabrics, loads and forces."""
    from softness_bayes.model.reach import wide_contacts

    ratings, fabrics = known["ratings"], known["fabrics"]
    least, greatest, conditions = ratings["least"], ratings["greatest"], known["conditions"]
    moduli = [one["e_fab_kpa"] for one in fabrics]
    paired = experiment.ratings.paired  # a comparison is one answer, in two rows
    each = [one["ratings"] // (1 + paired) for one in known["participants"]]
    given = f"{sum(each)} comparisons of two fabrics" if paired else f"{sum(each)}, from {least:g} to {greatest:g}"
    lines = {
        "ratings": f"{given}; {ratings['missing']} missing",
        "participants": f"{_span(experiment.ratings.participants)}, "
        f"{_extent(each)} {'comparisons' if paired else 'ratings'} each",
        "fabrics": f"{_span(experiment.ratings.fabrics)}, E_fab {min(moduli):.4g} to {max(moduli):.4g} kPa",
        "loads": _loads(experiment.ratings),
        "conditions": f"{conditions['rated']} of {conditions['possible']} pairs of fabric and load; "
        f"{conditions['by_participants']} of {conditions['possible_by_participants']} with each participant",
    }
    if wide := wide_contacts(experiment.ratings.loads, model.finger):
        lines["contact"] = wide
    if model.scale.own_units:
        lines["tau"] = _about_scales(experiment.ratings)
    if conditions["rated"] == 1:
        lines["gamma"] = "one condition: the response does not vary, so skin, receptors and gamma are not identifiable"
    if ratings["count"] > 1 and least == greatest:
        lines["varsigma"] = "all ratings are equal: their spread (varsigma) is not identifiable"
    yield from (f"{name:14}{text}" for name, text in lines.items())
    width = max(map(len, ("fabric", *(one["name"] for one in fabrics))))
    yield f"\n{'fabric':{width}}  E_fab (kPa)  Poisson ratio  ratings  modulus from"
    for one in fabrics:
        low, high = one["e_fab_low_kpa"], one["e_fab_high_kpa"]
        numbers = f"{one['e_fab_kpa']:11.4g}  {one['poisson_ratio']:13g}  {one['ratings']:7}"
        limits = "" if low is None else f"; 90 % limits {low:.3g} to {high:.3g} kPa"
        yield f"{one['name']:{width}}  {numbers}  {one['modulus_from'] or 'nothing (unknown)'}{limits}"
    exact = sum(one["e_fab_low_kpa"] is None for one in fabrics)
    if exact and model.modulus_cv is None:
        yield (
            f"warning: {'the' if exact == len(fabrics) else exact} moduli are given without errors. If measured moduli "
            "are treated as exact, the intervals are too narrow. Add a column effective_modulus_cv (or "
            "thickness_cv, tensile_modulus_cv, bending_rigidity_cv), or give the run --modulus-cv 0.15; use "
            "--modulus-cv 0 if they are exact"
        )
    if others := measurement_lines(experiment):
        yield from ("", *others)


def _about_scales(ratings: Ratings) -> str:
    """Return whether the spread of rating scales can be estimated."""
    from softness_bayes.model.build import raters_told

    if raters_told(ratings) > 1:
        who = "participants" if ratings.cells is None else "raters"
        return f"several {who}: the spread of their rating scales (tau) can be estimated"
    if ratings.cells is not None:
        return "means without standard deviations: the spread of raters' scales (tau) cannot be estimated"
    return "one participant: the spread of rating scales between participants (tau) cannot be estimated"


def _loads(ratings: Ratings) -> str:
    """Return the loads with their numbers of ratings; of many loads of one kind, their number and groups."""
    import numpy as np

    from softness_bayes.data import LOAD_COLUMNS
    from softness_bayes.touch.load_groups import groups_of

    counts, parts = np.bincount(ratings.load).tolist(), []
    for column, kind, _ in LOAD_COLUMNS:
        some = [(str(load), count) for load, count in zip(ratings.loads, counts, strict=True) if isinstance(load, kind)]
        if len(some) > MOST_SHOWN:
            total = counted(sum(count for _, count in some), "rating")
            parts.append(f"{len(some)} different {column.label}s, {some[0][0]} to {some[-1][0]} ({total})")
        else:
            parts += [f"{load} ({counted(count, 'rating')})" for load, count in some]
    groups = groups_of(ratings.loads)
    if groups.merged:
        sizes = np.bincount(groups.of[ratings.load]).tolist()
        each = ", ".join(f"{name} ({size})" for name, size in zip(groups.names, sizes, strict=True))
        parts.append(f"used as measured; shown and checked in {len(sizes)} groups: {each}")
    return ", ".join(parts)


def measurement_lines(data: Experiment | Measurements) -> list[str]:
    """Return lines on forces and recorded afferents, where there are any."""
    import numpy as np

    from softness_bayes.experiments.understanding import understood_measurements

    lines = []
    if data.compression is not None:
        fingers, depth, force = (
            data.compression.participants,
            data.compression.indentation * 1e3,
            data.compression.force,
        )
        each = _extent(np.bincount(data.compression.participant).tolist())
        lines += [
            f"forces        {len(force)}, from {force.min():.3g} to {force.max():.3g} N; "
            f"{counted(data.compression.n_zero, 'row')} with a force of 0 left out",
            f"fingers       {_span(fingers)}, {each} forces each",
            f"indentations  {depth.min():.3g} to {depth.max():.3g} mm",
        ]
    if data.afferents is not None:
        known, names = understood_measurements(data)["afferents"], data.afferents.names
        rates, curvatures, places = (
            "{:.4g} to {:.4g}".format(*known["ranges"][name])
            for name in ("rate_hz", "probe_curvature_per_m", "distance_mm")
        )
        who = f"{_span(names)} named" if names else "none named: every row is a mean of several"
        lines += [
            f"afferents     {who}{''.join(f'; {name}' for name in data.afferents.species)}",
            f"responses     {known['rates']} rates and {known['counts']} counts, {rates} Hz",
            f"probes        curvature {curvatures} /m (0 is flat), {places} mm from the contact's axis",
            f"probed at     {_span(known['loads'])}",
        ]
    return lines


def _span(names: Sequence[str]) -> str:
    """Return the number of names, and the first and last of them."""
    return f"{len(names)} ({' … '.join(dict.fromkeys((names[0], names[-1])))})"


def _extent(counts: list[int]) -> str:
    """Return the range of some counts as text."""
    return " to ".join(dict.fromkeys((str(min(counts)), str(max(counts)))))
