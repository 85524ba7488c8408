"""A finished run: its draws, predictions and provenance, in memory and in its directory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base import arviz_bridge
from softness_bayes.base.defaults import ANSWER_DRAWS
from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import write_outputs
from softness_bayes.base.files.run_files import ANSWERS, FINGERS, MODULI, MODULUS_ERRORS, POSTERIOR, RULER, RUN, SUMMARY
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.base.ranges import numbers, require_kind, require_mapping
from softness_bayes.base.readable import number
from softness_bayes.checking.inflection import STORED, Curves, Inflection, turning_table
from softness_bayes.data.columns import LOAD_CV
from softness_bayes.data.ratings import FREE_TOUCH
from softness_bayes.parameters.declared import TOUCH_FORCE
from softness_bayes.results.stored import SUMMARY_TABLE, Stored, content_of, read_file
from softness_bayes.touch.contact import Load, require_loads
from softness_bayes.touch.load_groups import LoadGroups, groups_of

if TYPE_CHECKING:
    from softness_bayes.data import Fabrics
    from softness_bayes.people.ruler import Fit
    from softness_bayes.plotting.figures import Plots
    from softness_bayes.results.ranking import Ranking
    from softness_bayes.results.target import Target

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Result(Stored):
    """Draws, predictions and provenance of one run."""

    @property
    def is_first_look(self) -> bool:
        """True if the run ended on purpose at the first check of the chains (`--quick`)."""
        return bool(self.tree.attrs.get("quick", False))

    def labelled(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return a table with a column `preliminary`, True in every row, if the chains have not converged."""
        return table if self.provenance.ending.converged else table.assign(preliminary=True)

    @property
    def load_groups(self) -> LoadGroups:
        """Groups of loads for checks and figures; with few loads, each load is a separate group."""
        return groups_of(self.loads)

    def summary(self) -> pd.DataFrame:
        """Return mean, standard deviation, interval and Monte-Carlo error of every parameter."""
        return self.table.copy()

    def learnt(self) -> tuple[str, ...]:
        """Return sentences on what the data determine and what they do not: parameters, then combinations."""
        from softness_bayes.checking.sentences import (
            direction_sentences,
            information_sentences,
            modulus_sentences,
            rater_sentences,
        )

        kinds = {MODULI: modulus_sentences, FINGERS: rater_sentences, ANSWERS: rater_sentences}
        latent = (line for name, say in kinds.items() if name in self.tables for line in say(self.tables[name]))
        return (*information_sentences(self.table), *direction_sentences(self.tables["directions"]), *latent)

    def checked(self) -> tuple[str, ...]:
        """Return the findings of the predictive checks as sentences: turning points, then everything else.

        Raises
        ------
        InputError
            If the run had no ratings.
        """
        from softness_bayes.checking.sentences import check_sentences

        self._require_ratings()
        return tuple(check_sentences(self.tables["predictive_checks"]))

    def curves(self) -> Curves:
        """Return the stored response as a function of E_fab, for each draw and each load or group of loads.

        For a group, the curves are those of its representative load (`load_groups`).
        """
        self._require_ratings()
        stored = self.group("predictions").isel(chain=0)
        return Curves(
            stored["e_fab_kpa"].values * 1e3,
            stored["total_rate"].values,
            stored["e_skin_kpa"].values * 1e3,
            stored["contact_force_n"].values,
            stored["contact_radius_mm"].values * 1e-3,
        )

    def typical_ratings(self) -> Array:
        """Return the rating of a typical participant along `curves`, shape (draws, loads, points)."""
        self._require_ratings()
        stored = self.group("predictions")
        return np.asarray(stored["typical_rating"].isel(chain=0).values)

    def inflections(self) -> Inflection:
        """Return the turning points (maxima) of the response for each draw, under the loads of `curves`."""
        self._require_ratings()
        draws = self._turning("inflection")
        flat: list[Any] = [values.reshape(-1, values.shape[-1]) for values in draws]
        return Inflection(*flat)

    def _turning(self, group: str) -> Inflection:
        """Return the turning points of a group, with fields of shape (chains, draws, shown loads)."""
        stored = self.group(group)
        found: list[Any] = [stored[name].values * (factor or 1) for name, factor, _ in STORED.values()]
        return Inflection(*found)._replace(inside=found[-1].astype(bool))

    @property
    def least_drop(self) -> float:
        """Smallest drop, as a share of the maximum, towards both ends of the range that makes it a turning point."""
        return self.provenance.errors.inflection_least_drop

    def inflection(self) -> pd.DataFrame:
        """Return the table of turning points (maxima of the response), one row per load or group of loads.

        The row of a group (`load_groups`) refers to its representative load.

        Columns: probabilities of the three outcomes (p_interior: a maximum that exceeds both ends of the range by
        `least_drop` of itself, p_none, p_silent), of the first under the prior (prior_p_interior), and of a maximum
        inside the fabrics' own range (p_inside); then median and 5-95 % limits of E_fab [kPa], E_fab / E_skin, Hertz's
        force [N] and the drop beyond it, over the draws with a turning point, as NAME, NAME_low and NAME_high. Each of
        these has a Monte-Carlo standard error in COLUMN_mcse.
        """
        self._require_ratings()
        names = self.load_groups.names
        drawn, prior = (self._turning(name) for name in ("inflection", "prior_inflection"))
        ensembles = np.unique(self.group("sample_stats")[arviz_bridge.ENSEMBLE]).size
        # weighted draws are one chain
        return turning_table(drawn, names, prior, min(ensembles, len(drawn.outcome)))

    @property
    def fit(self) -> Fit:
        """The answer to whether the model follows the ratings."""
        from softness_bayes.people.ruler import fit_of

        self._require_ratings()
        return fit_of(self.tree, self.tables.get(RULER))

    @property
    def faults(self) -> list[str]:
        """Reasons why the fit has failed; of a chain that may still change, its direction alone."""
        from softness_bayes.people.ruler import UNKNOWN
        from softness_bayes.people.sentences import fit_faults

        if not self.has_ratings:
            return []
        return fit_faults(self.fit if self.provenance.ending.converged else self.fit._replace(follows=UNKNOWN))

    @property
    def moduli_assumed(self) -> bool:
        """True if moduli were taken as exact without being declared so."""
        asked = self.provenance.asked.options.get("modulus_cv")
        return self.has_ratings and asked is None and MODULI not in self.tables

    def said_of_moduli(self) -> tuple[str, ...]:
        """Return sentences on what errors of the moduli would do to the conclusions."""
        from softness_bayes.checking.sentences import shift_sentences

        return (*shift_sentences(self.tables[MODULUS_ERRORS]),) if MODULUS_ERRORS in self.tables else ()

    @property
    def load_cv(self) -> NDArray[np.float64]:
        """Relative standard error of each rating's load used in the run; 0 if taken as exact.

        Raises
        ------
        InputError
            If the run had no ratings.
        """
        self._require_ratings()
        constant, asked = self.group("constant_data"), self.provenance.asked.options.get("load_cv")
        every = np.full(constant["load_index"].size, np.nan)
        own = constant[LOAD_CV.name].values if LOAD_CV.name in constant else every
        return np.where(np.isnan(own), asked or 0.0, own)

    @property
    def shared_load_cv(self) -> float:
        """Relative standard error of each load, shared by all its ratings, as used in the run; 0 if there is none."""
        return self.provenance.asked.options.get("shared_load_cv") or 0.0

    def said_of_force(self) -> str:
        """Return what an unknown force of free touches means for the conclusions; empty if loads were given."""
        if FREE_TOUCH not in self.loads:
            return ""
        sampled = TOUCH_FORCE in self.group("posterior")
        force = self.group("posterior" if sampled else "constant_data")[TOUCH_FORCE].values
        low, middle, high = (number(x) for x in np.quantile(force, (0.05, 0.5, 0.95)))
        return (
            f"nobody measured how hard people pressed: {middle} N ({low} to {high}, 90 %), one force for all ratings. "
            "Ratings under one force tell little more than moduli and stresses over it, so b and sigma_0 are as "
            "uncertain, and nothing is said of other forces; measure it, or rate under two known loads"
        )

    def said_of_loads(self) -> str:
        """Return in one sentence whether loads were taken as exact."""
        if FREE_TOUCH in self.loads:
            return f"loads: {self.said_of_force()}"
        if self.shared_load_cv:
            return (
                f"loads: the model includes a relative error of {self.shared_load_cv:.3g} of each load, shared "
                "by all its ratings"
            )
        given = self.provenance.asked.options.get("load_cv") is not None or LOAD_CV.name in self.group("constant_data")
        cv = self.load_cv
        if cv.any():
            low, high = cv[cv > 0].min(), cv.max()
            size = f"{high:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
            return (
                f"loads: the model includes relative errors of {size}, independent for each rating, for "
                f"{(cv > 0).sum()} of {cv.size} ratings"
            )
        if given:
            return "loads: exact, as stated"
        return (
            "loads: treated as exact, because no errors were given (--load-cv 0.05, or a column load_cv); any "
            "errors become part of the rating noise, which is the same for every touch"
        )

    @property
    def moduli(self) -> pd.DataFrame | None:
        """Posterior of each uncertain modulus; None if all were known exactly (see `modulus_table`)."""
        return self.tables[MODULI].copy() if MODULI in self.tables else None

    @property
    def fingers(self) -> pd.DataFrame | None:
        """Posterior of individual fingers; None if all raters have the typical one (see `deviation_table`)."""
        return self.tables[FINGERS].copy() if FINGERS in self.tables else None

    @property
    def answers(self) -> pd.DataFrame | None:
        """Posterior of individual exponents and noise; None if all raters have typical ones (see `deviation_table`)."""
        return self.tables[ANSWERS].copy() if ANSWERS in self.tables else None

    def predict(
        self,
        fabrics: Fabrics | pd.DataFrame | None = None,
        loads: Sequence[Load] | None = None,
        draws: int = ANSWER_DRAWS,
        raters: int | None = None,
        seed: int = 0,
        values: Mapping[str, float] | None = None,
    ) -> pd.DataFrame:
        """Predict contact, stress, firing and ratings of fabrics under loads, with their credible limits.

        Parameters
        ----------
        fabrics
            Fabrics that are touched, or a DataFrame with their columns; by default those of the data. Uncertain moduli
            of rated fabrics are taken from the posterior, those of others from their laws.
        loads
            Loads; by default those of the data.
        draws
            Number of posterior draws for medians and limits.
        raters
            Number of new raters whose mean rating is predicted; by default the number of raters in the data.
        seed
            Seed of new raters and of noise.
        values
            Values of sampled parameters in natural units, by name, as in ``{"b": 80}``. If any are given, all others
            are fixed at their posterior medians, and limits include only the uncertainty of ratings: of their level
            given the data and these parameters, of raters and of noise.

        Returns
        -------
        DataFrame
            A row per fabric and load: medians as in `prediction_table`, with 5-95 % limits as NAME_low and NAME_high,
            then ratings with the reasons for unusual predictions (`rating_table.predicted`).

        Raises
        ------
        InputError
            If the run had no ratings, which determine the receptors' parameters, or a value cannot be set.
        """
        from softness_bayes.results.fitted import Fitted
        from softness_bayes.results.rating_table import predicted

        if values is not None:
            require_mapping("values", values, '{"b": 80}')
        touched = self._touched(fabrics, loads)
        return predicted(Fitted(self, draws, values), *touched, raters, seed)[0]

    def rank(
        self,
        fabrics: Fabrics | pd.DataFrame | None = None,
        loads: Sequence[Load] | None = None,
        draws: int = ANSWER_DRAWS,
        seed: int = 0,
    ) -> Ranking:
        """Rank fabrics by predicted softness; arguments and errors as for `predict`.

        Returns
        -------
        Ranking
            The order under each load: its `table`, the probabilities of all places and pairs, and a `figure`.
        """
        from softness_bayes.results.ranking import Ranking

        return Ranking(self, *self._touched(fabrics, loads), draws, seed)

    def target(
        self,
        rating: float,
        loads: Sequence[Load] | None = None,
        tensile_modulus: float | None = None,
        thickness: float | None = None,
        poisson_ratio: float | None = None,
        draws: int = ANSWER_DRAWS,
        seed: int = 0,
    ) -> Target:
        """Find the fabrics with a desired rating.

        Parameters
        ----------
        rating
            Rating of the typical rater, on the scale of the data.
        loads, draws, seed
            As for `predict`.
        tensile_modulus
            E_ten of the fabric [Pa]; if given, its thickness is found, too.
        thickness
            h of the fabric [m]; if given, its tensile modulus is found, too.
        poisson_ratio
            nu_fab of the fabric [-]; by default the median of those rated.

        Returns
        -------
        Target
            The effective moduli that give the rating, draw by draw, and their `table`.

        Raises
        ------
        InputError
            If the rating is not on the scale of the run, or a property is out of range.
        """
        from softness_bayes.results.target import Cloth, target

        numbers("rating", rating, "a number")
        pressed = self._touched(None, loads)[1]
        return target(self, rating, pressed, Cloth(tensile_modulus, thickness, poisson_ratio), draws, seed)

    def _touched(
        self, fabrics: Fabrics | pd.DataFrame | None, loads: Sequence[Load] | None
    ) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the given fabrics and loads; by default those of the data."""
        from softness_bayes.data import Fabrics
        from softness_bayes.data.fabrics import warn_of_moduli

        if isinstance(fabrics, pd.DataFrame):
            fabrics = Fabrics.read(fabrics)
        if fabrics is not None:
            require_kind("fabrics", fabrics, Fabrics, "Fabrics, such as Fabrics(('felt',), effective_modulus=3e4)")
            warn_of_moduli(fabrics)
        pressed = self.loads if loads is None else require_loads("loads", loads)
        return self.fabrics if fabrics is None else fabrics, pressed

    @property
    def plot(self) -> Plots:
        """Figures of the run, one method each: ``result.plot.response()`` (see `plotting.figures.Plots`)."""
        from softness_bayes.plotting.figures import Plots

        return Plots(self)

    def _repr_html_(self) -> str:
        """Return verdict, turning points and summary as HTML for a notebook."""
        said = [*(f"the fit failed: {fault}" for fault in self.faults), self.provenance.verdict]
        columns = ["p_interior", "prior_p_interior", "p_none", "p_silent"]
        columns += ["e_fab_kpa_low", "e_fab_kpa", "e_fab_kpa_high"]
        tables = {"where the response turns over": self.inflection()[columns]} if self.has_ratings else {}
        tables["parameters"] = self.summary()
        lines = [f"<p><strong>{escape(line)}</strong></p>" for line in said]
        for title, table in tables.items():
            html = table.to_html(float_format="{:.4g}".format, na_rep="–", border=0)
            lines.append(f"<p>{title}</p>{html}")
        return "\n".join(lines)

    def save(self, directory: str | Path) -> None:
        """Write ``posterior.nc`` and the tables to a directory, either all of them or none.

        A result saved there earlier is replaced.

        Raises
        ------
        InputError
            If another file of the same name exists there, or a file was changed since it was saved.
        OSError
            If there is no space or no permission; the earlier files remain.
        """
        whole = content_of(self.tree, {SUMMARY_TABLE: self.table, **self.tables})
        contents: dict[str, bytes | str] = {POSTERIOR: whole}
        for name, table in {
            SUMMARY: self.table,
            **{f"{name}.csv": table for name, table in self.tables.items()},
        }.items():
            contents[name] = csv_of(self.labelled(table) if self.is_first_look else table)
        write_outputs(Path(directory), contents, RUN)

    @classmethod
    def load(cls, directory: str | Path, verify: bool = True, trust_code: bool = False) -> Result:
        """Read a result from its directory, or from its ``posterior.nc``, which also contains the tables.

        Parameters
        ----------
        directory
            Directory in which it was saved.
        verify
            Whether to reject a file that was changed since it was written. To accept a deliberate change, load it with
            False and `save` it.
        trust_code
            Whether to import modules that the result names, such as those of a custom reading or prior, and that this
            program has not imported: importing a module runs it. They are not searched for in the working directory.

        Raises
        ------
        InputError
            If there is no result, it cannot be read, it is damaged or lacks something, its schema is newer than
            this version knows, or it names code that is not trusted.
        """
        from softness_bayes.results.lookup import Named

        require_kind("directory", directory, (str, Path), "a path")
        path = Path(directory)
        path = path / POSTERIOR if path.is_dir() else path
        if not path.is_file():
            raise InputError(f"{path}: no such file; expected the {POSTERIOR} of a run")
        tree, tables = read_file(path, verify, trust_code)
        summary = tables.pop(SUMMARY_TABLE)
        found = cls(tree, summary, Named(tables, "table", str(path)), str(path))
        if tree.attrs.get("noise"):
            from softness_bayes.results.data_groups import restore_curves

            restore_curves(found)
        return found
