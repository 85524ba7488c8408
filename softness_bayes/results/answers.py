"""Answers of a finished run to questions about fabrics and loads: predictions, rankings, targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from softness_bayes.defaults import ANSWER_DRAWS
from softness_bayes.kinds import numbers, require_kind, require_mapping
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Load, require_loads

if TYPE_CHECKING:
    import pandas as pd

    from softness_bayes.data import Fabrics
    from softness_bayes.results.ranking import Ranking
    from softness_bayes.results.target import Target


class Answers(Stored):
    """Methods of a `Result` that evaluate its model at new touches."""

    def predict(
        self,
        fabrics: Fabrics | None = None,
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
            Fabrics that are touched; by default those of the data. Uncertain moduli of rated fabrics are taken from the
            posterior, those of others from their laws.
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
            then the ratings of `rating_columns` with the reasons for unusual predictions.

        Raises
        ------
        InputError
            If the run had no ratings, which determine the receptors' parameters, or a value cannot be set.
        """
        import numpy as np
        import pandas as pd

        from softness_bayes.model.prediction import drawn_parameters, prediction_table
        from softness_bayes.model.scenes import scene_of
        from softness_bayes.results.fitted import drawn_moduli, drawn_values, moduli_of
        from softness_bayes.results.rating_table import joined, parts_of, rating_columns

        if values is not None:
            require_mapping("values", values, '{"b": 80}')
        _require_fabrics(fabrics)
        pressed = self.loads if loads is None else require_loads("loads", loads)
        named = drawn_values(self, draws, values)
        fabrics = self.fabrics if fabrics is None else fabrics
        tables = []
        for some in parts_of(fabrics, len(pressed), draws):
            noise, moduli = self.provenance.rating_model.noise, moduli_of(self, some)
            scene = scene_of(some, pressed, named, self.readings, noise=noise, finger=self.finger, moduli=moduli)
            own = drawn_moduli(self, named, some, np.random.default_rng(seed))  # the draws of `rating_columns`
            touched = prediction_table(some, scene, drawn_parameters(named), modulus=own)
            rated = rating_columns(self, some, scene, draws, raters, seed, values)
            tables.append(pd.concat([touched, rated], axis=1))
        return joined(tables, len(pressed))

    def rank(
        self,
        fabrics: Fabrics | None = None,
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
        from softness_bayes.results.ranking import rank

        _require_fabrics(fabrics)
        pressed = self.loads if loads is None else require_loads("loads", loads)
        return rank(self, self.fabrics if fabrics is None else fabrics, pressed, draws, seed)

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
        pressed = self.loads if loads is None else require_loads("loads", loads)
        return target(self, rating, pressed, Cloth(tensile_modulus, thickness, poisson_ratio), draws, seed)


def _require_fabrics(fabrics: Fabrics | None) -> None:
    from softness_bayes.data import Fabrics

    require_kind(
        "fabrics", fabrics, (Fabrics, type(None)), "Fabrics, such as Fabrics(('felt',), effective_modulus=3e4)"
    )
