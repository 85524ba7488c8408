"""Answers of a finished run to questions about fabrics and loads: predictions, rankings, targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from softness_bayes.defaults import ANSWER_DRAWS
from softness_bayes.kinds import numbers, require_kind, require_mapping
from softness_bayes.results.read_back import moduli_at
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Load, require_loads

if TYPE_CHECKING:
    import pandas as pd

    from softness_bayes.data import Fabrics
    from softness_bayes.results.ranking import Ranking
    from softness_bayes.results.target import Target


class Answers:
    """The methods of a `Result` that run its model anew."""

    def predict(
        self: Stored,
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
            What is touched; by default the fabrics of the data, by their moduli, which are those of the posterior where
            they were not known exactly.
        loads
            How; by default the loads of the data.
        draws
            Posterior draws that median and limits are of.
        raters
            Number of new raters of whose ratings the mean is predicted; by default as many as rated.
        seed
            Seed of new raters and of the noise of their ratings.
        values
            Name -> value in natural units of sampled parameters, as in ``{"b": 80}``. If any are given, all others are
            held at their posterior medians, and limits are those of the ratings alone: of their level given the data
            and these parameters, of raters and of noise.

        Returns
        -------
        DataFrame
            A row per fabric and load: medians as `prediction_table` gives them, with 5-95 % limits as NAME_low and
            NAME_high, then the ratings of `rating_columns`, and why they are what they are.

        Raises
        ------
        InputError
            If the run had no ratings, which say what the receptors do, or a value cannot be set.
        """
        import pandas as pd

        from softness_bayes.model.prediction import drawn_parameters, prediction_table
        from softness_bayes.model.scenes import scene_of
        from softness_bayes.results.fitted import drawn_values
        from softness_bayes.results.rating_table import rating_columns

        if values is not None:
            require_mapping("values", values, '{"b": 80}')
        _require_fabrics(fabrics)
        pressed = self.loads if loads is None else require_loads("loads", loads)
        named = drawn_values(self, draws, values)
        own = moduli_at(named, self.fabrics) if fabrics is None else None
        fabrics = self.fabrics if fabrics is None else fabrics
        noise = self.provenance.rating_model.noise
        scene = scene_of(fabrics, pressed, named, self.readings, noise=noise, finger=self.finger)
        touched = prediction_table(fabrics, scene, drawn_parameters(named), modulus=own)
        return pd.concat([touched, rating_columns(self, fabrics, scene, draws, raters, seed, values)], axis=1)

    def rank(
        self: Stored,
        fabrics: Fabrics | None = None,
        loads: Sequence[Load] | None = None,
        draws: int = ANSWER_DRAWS,
        seed: int = 0,
    ) -> Ranking:
        """Rank fabrics by predicted softness; arguments and errors as `predict` has them.

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
        self: Stored,
        rating: float,
        loads: Sequence[Load] | None = None,
        tensile_modulus: float | None = None,
        thickness: float | None = None,
        poisson_ratio: float | None = None,
        draws: int = ANSWER_DRAWS,
        seed: int = 0,
    ) -> Target:
        """Find the fabrics that have a wished rating.

        Parameters
        ----------
        rating
            Rating of the typical rater, as the data have it.
        loads, draws, seed
            As `predict` has them.
        tensile_modulus
            E_ten of the fabric [Pa], for which its thickness is found too.
        thickness
            h of the fabric [m], for which its tensile modulus is found too.
        poisson_ratio
            nu_fab of the fabric [-]; by default the median of those rated.

        Returns
        -------
        Target
            The effective moduli that give the rating, draw by draw, and their `table`.

        Raises
        ------
        InputError
            If the rating is not one of the run's scale, or a property is out of range.
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
