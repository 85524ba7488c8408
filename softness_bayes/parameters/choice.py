"""Choice of the sampled parameters: fixed values, other priors, and absent parameters."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import replace

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import Prior, Signed, magnitude
from softness_bayes.base.ranges import require_mapping
from softness_bayes.parameters import joint as joint_law
from softness_bayes.parameters.declared import (
    ANSWER_PARAMETERS,
    ERROR_PARAMETERS,
    EVERY_PARAMETER,
    FINGER_PARAMETERS,
    HELD,
    MODULUS_SCALES,
    PARAMETERS,
    PLATE_PARAMETERS,
    PRIOR_SETS,
    RECORDING_PARAMETERS,
    SHAPE_PARAMETERS,
    TOUCH_FORCE,
    Parameter,
)
from softness_bayes.parameters.joint import JOINT_LAWS
from softness_bayes.parameters.priors import as_prior
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.touch.contact import STRAIN, SkinDisplacement
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, Channels, Membrane
from softness_bayes.touch.neuron.surface import DESIGNS, FiringSurface

_ROUNDING = 1e-9


def parameter_space(
    fix: Mapping[str, float] | None = None,
    priors: Mapping[str, Prior] | None = None,
    prior_set: str = "default",
    skin_displacement: SkinDisplacement = STRAIN,
    n_participants: int | None = None,
    absent: Collection[str] = (),
    n_fingers: int | None = None,
    membrane: Membrane = CONNOR_STEVENS,
    spreads: Collection[str] = (),
    of_errors: Collection[str] = (),
    signed: Collection[str] = (),
    recorded: Collection[str] = (),
) -> ParameterSpace:
    """Return the space of the sampled parameters with their priors, and the values of the fixed ones.

    Parameters
    ----------
    fix
        Parameters to fix, with their values in natural units.
    priors
        Priors that replace the declared ones. A prior for a `HELD` parameter or one of `SHAPE_PARAMETERS` makes it
        sampled; otherwise the latter have the values of the finger.
    prior_set
        A name of `PRIOR_SETS`.
    skin_displacement
        Reading of the skin's displacement, which determines unit and prior of m.
    n_participants
        Number of participants. With one, tau is not identifiable in addition to mu and is fixed at 0.
    absent
        Parameters that are not in the present model: neither sampled nor fixed.
    n_fingers
        Number of fingers in the compression data; without any there are no `PLATE_PARAMETERS`. With one finger, the
        spreads between fingers are not identifiable in addition to b and m and are fixed at 0.
    membrane
        Reading of the membrane, whose firing-rate surface limits alpha and the channel multipliers. The multiplier of a
        channel absent from the membrane is fixed.
    spreads
        The `FINGER_PARAMETERS` of ratings (spreads of individual fingers), or `ANSWER_PARAMETERS`.
    of_errors
        The `ERROR_PARAMETERS` of the error law of ratings.
    signed
        Parameters that have either sign with probability 1/2; their priors are those of their magnitudes.
    recorded
        The `RECORDING_PARAMETERS` of recorded afferents.

    Raises
    ------
    InputError
        If a name is unknown or absent, a parameter is both fixed and sampled, or a value or a prior's support is
        outside the parameter's range.
    """
    require_mapping("fix", fix or {}, "{'m': 2.0}")
    require_mapping("priors", priors or {}, "{'b': 'lognormal(100,0.5)'}")
    fix, priors = dict(fix or {}), {name: as_prior(name, prior) for name, prior in (priors or {}).items()}
    freed = priors.keys()
    absent = {*absent, *(FINGER_PARAMETERS.keys() - {*(PLATE_PARAMETERS if n_fingers else ()), *spreads})}
    absent |= (ERROR_PARAMETERS.keys() - {*of_errors}) | (ANSWER_PARAMETERS.keys() - {*spreads})
    absent |= RECORDING_PARAMETERS.keys() - {*recorded}
    _require_free_to_choose(freed, fix, absent, prior_set)
    absent |= {*SHAPE_PARAMETERS, *MODULUS_SCALES, TOUCH_FORCE} - freed
    forced = _not_identifiable(freed, n_participants, n_fingers, membrane)
    fix |= {name: value for name, value in forced.items() if name not in {*fix, *absent}}
    held = {name: value for name, value in HELD.items() if name not in (*freed, *absent)} | fix
    joint = JOINT_LAWS.get(prior_set)
    if joint is not None:
        if changed := sorted({*joint_law.NAMES, *Channels._fields} & {*priors, *fix, *absent, *freed}):
            raise InputError(
                f"prior set '{prior_set}': {changed[0]} is given a prior or a value, or is not in this model; expected "
                f"ratings, with {', '.join(joint_law.NAMES)} under their joint law and the paper's channels"
            )
        held |= {name: PARAMETERS[name].prior.median for name in Channels._fields}
    require_values(held)
    if skin_displacement in PRIOR_SETS[prior_set]:
        priors = {**PRIOR_SETS[prior_set][skin_displacement], **priors}
    elif missing := [name for name in ("b", "m") if name not in {*held, *priors}]:
        raise InputError(
            f"skin_displacement={skin_displacement.name}: no set of priors covers this reading; give --prior "
            f"or --fix for {' and '.join(missing)} (in Python priors or fix)"
        )
    units = dict.fromkeys(("m", "tau_m", "m_rec"), skin_displacement.exponent_unit)
    sampled = []
    for name, p in EVERY_PARAMETER.items():
        if name not in {*held, *absent}:
            prior = p.suited(magnitude(priors.get(name, p.prior)))
            prior = Signed(prior) if name in signed else prior
            sampled.append(replace(p, prior=prior, unit=units.get(name, p.unit)))
    # a membrane without a firing-rate surface still has default values; computing its rates raises a clear error
    if membrane.name not in DESIGNS or not any(p.name in Channels._fields for p in sampled):
        return ParameterSpace(tuple(sampled), held, None, joint=joint)
    firing = FiringSurface.load(membrane)
    return ParameterSpace(_within_surface(sampled, held, firing), held, firing)


def _require_free_to_choose(freed: Set[str], fix: Mapping[str, float], absent: Collection[str], prior_set: str) -> None:
    """Raise an error for parameters not in the model or both fixed and sampled, and for an unknown set of priors."""
    for name in (*fix, *freed):
        declared(name)
        if name in fix and name in SHAPE_PARAMETERS:
            raise InputError(
                f"{name} is a value of the finger: set it with --finger {name}_mm=VALUE (in Python a Finger), "
                "or give it a prior to sample it"
            )
        if name in fix and name in MODULUS_SCALES:
            raise InputError(f"{name} cannot be fixed: multiply the moduli of the table by it, or give it a prior")
        if name in absent:
            raise InputError(f"{name}: the model of these data has no such parameter; omit it")
    if clash := sorted(freed & fix.keys()):
        raise InputError(f"{clash[0]} is both fixed and given a prior; choose one")
    if prior_set not in PRIOR_SETS:
        raise InputError(f"prior set '{prior_set}': expected one of {', '.join(PRIOR_SETS)}")


def _not_identifiable(
    freed: Collection[str], n_participants: int | None, n_fingers: int | None, membrane: Membrane
) -> dict[str, float]:
    """Return the parameters not identifiable from these data or for this membrane, with their fixed values.

    Raises
    ------
    InputError
        If one of them is to be sampled.
    """
    alone = {"tau": ("participant", n_participants), "tau_b": ("finger", n_fingers), "tau_m": ("finger", n_fingers)}
    found = {
        name: (0.0, f", because there is only one {one}: fix it or omit it")
        for name, (one, number) in alone.items()
        if number == 1
    }
    for name in membrane.without_effect:
        found[name] = PARAMETERS[name].prior.median, f": the membrane {membrane.name} has no such current; omit it"
    for name, (_, why) in found.items():
        if name in freed:
            raise InputError(f"{name} cannot be sampled{why}")
    return {name: value for name, (value, _) in found.items()}


def _within_surface(
    sampled: Sequence[Parameter], held: Mapping[str, float], firing: FiringSurface
) -> tuple[Parameter, ...]:
    """Return the parameters with alpha limited to the firing-rate surface, for sampled channel multipliers.

    Raises
    ------
    InputError
        If the prior of a multiplier, or the median of that of alpha, or a fixed alpha, is outside the range of the
        surface.
    """
    channels = [p for p in sampled if p.name in Channels._fields]
    for p in channels:
        low, high = firing.design.interval(p.name)
        if p.prior.support[0] < low * (1 - _ROUNDING) or p.prior.support[1] > high * (1 + _ROUNDING):
            raise InputError(
                f"prior of {p.name}: {p.prior} reaches beyond {low:g} to {high:g}, the range of the "
                f"firing-rate surface; expected a prior within that range, as {PARAMETERS[p.name].prior} does, "
                f"or {p.name} fixed"
            )
    if held.get("alpha", 0.0) > firing.max_current:
        raise InputError(
            f"alpha is {held['alpha']}, expected at most {firing.max_current:g} µA/cm², the range of the "
            f"firing-rate surface; fix {', '.join(p.name for p in channels)} too for larger ones"
        )
    within = []
    for p in sampled:
        if p.name == "alpha":
            p = replace(p, range=replace(p.range, high=firing.max_current))
            replace(p, unit=f"{p.unit}, the range of the firing-rate surface").suited(p.prior)
        within.append(p)
    return tuple(within)


def require_values(values: Mapping[str, float]) -> None:
    """Raise an error for values [natural units] outside the ranges of their parameters.

    Raises
    ------
    InputError
        For an unknown parameter, or a value outside its range.
    """
    for name, value in values.items():
        one = declared(name)
        replace(one.range, unit=one.unit).require(name, value)


def require_priors(priors: Mapping[str, Prior]) -> None:
    """Raise an error for priors of unknown parameters, or with a support outside the parameter's range.

    Raises
    ------
    InputError
        Naming the parameter, and the range of its values.
    """
    for name, prior in priors.items():
        declared(name).suited(prior)


def declared(name: str) -> Parameter:
    """Return the declaration of a parameter.

    Raises
    ------
    InputError
        If there is no parameter of this name.
    """
    if name not in EVERY_PARAMETER:
        raise InputError(f"no parameter '{name}'; expected one of {', '.join(EVERY_PARAMETER)}")
    return EVERY_PARAMETER[name]
