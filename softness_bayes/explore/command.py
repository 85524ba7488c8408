"""Command lines that reproduce the numbers of a state: a table of one fabric, and `predict` with all parameters."""

from __future__ import annotations

import csv
import io
import shlex
from collections.abc import Mapping

from softness_bayes.data.loads import LOAD_COLUMNS
from softness_bayes.explore.subject import State, Subject
from softness_bayes.model.fingers import values_of
from softness_bayes.parameters.declared import SHAPE_PARAMETERS
from softness_bayes.parameters.fabric_moduli import KPA
from softness_bayes.touch.contact import Load
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import Readings

TABLE = "explored.csv"
"""The table of the fabric, which the first line writes."""


def repeating(subject: Subject, state: State) -> str:
    """Return the lines that reproduce the touch of a state: a table of its fabric, and the prediction for it."""
    words = ["softness-bayes", "predict", "--fabrics", TABLE, *_load(subject.loads[state.load])]
    if subject.rated is not None:
        # finger, readings, noise and the medians of parameters without a slider come from the run
        words += ["--posterior", subject.rated.source, *_set(state.values)]
    else:
        words += _of_priors(subject, state)
    lines = [f"printf '%s\\n' {' '.join(map(shlex.quote, _table(subject, state)))} > {TABLE}", shlex.join(words)]
    return "\n".join(lines)


def _of_priors(subject: Subject, state: State) -> list[str]:
    """Return the options that pass all values, the finger and the readings to `predict`."""
    values = subject.values(state)
    words = _set({n: values[n] for n in TouchParameters._fields if n in values and n not in SHAPE_PARAMETERS})
    finger = values_of(subject.finger) | {f"{n}_mm": values[n] for n in SHAPE_PARAMETERS if n in values}
    words += [word for name, value in finger.items() for word in ("--finger", f"{name}={_written(value)}")]
    usual = Readings().names
    changed = {place: name for place, name in subject.readings.names.items() if name != usual[place]}
    return words + [word for place, name in changed.items() for word in ("--reading", f"{place}={name}")]


def _set(values: Mapping[str, float]) -> list[str]:
    """Return the options that set parameters."""
    return [word for name, value in values.items() for word in ("--set", f"{name}={_written(value)}")]


def _table(subject: Subject, state: State) -> list[str]:
    """Return the rows of a table with this fabric only."""
    if state.fabric is None:
        name, modulus, poisson = "explored", state.modulus_kpa, subject.poisson_ratio
    else:
        fabrics, k = subject.fabrics, state.fabric
        name, modulus, poisson = fabrics.names[k], fabrics.effective_modulus[k] / KPA, fabrics.poisson_ratio[k]
    # twelve digits reproduce the table's value and hide the rounding of the unit conversion
    row, text = (name, f"{modulus:.12g}", f"{poisson:.12g}"), io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([("fabric", "effective_modulus_kpa", "poisson_ratio"), row])
    return text.getvalue().splitlines()


def _written(number: float) -> str:
    return repr(float(number)).removesuffix(".0")


def _load(load: Load) -> list[str]:
    column = next(entry.column for entry in LOAD_COLUMNS if isinstance(load, entry.kind))
    return [f"--{column.name.replace('_', '-')}", str(load).partition(" ")[0]]
