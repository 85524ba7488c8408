"""The page of the model says what the code does: its equations, readings, constants, priors and criteria."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.claims import CLAIMS
from softness_bayes.data import Fabrics
from softness_bayes.likelihood.directions import RATING_DIRECTIONS
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.models import rating_model
from softness_bayes.likelihood.scales import RATING_SCALES
from softness_bayes.parameters.declared import EVERY_PARAMETER, HELD, PRIOR_SETS
from softness_bayes.parameters.priors import LAWS, parse_prior
from softness_bayes.touch.contact import (
    Finger,
    Force,
    Indentation,
    solve_contact,
)
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, MEMBRANES, PAPER_CHANNELS
from softness_bayes.touch.neuron.onset import onset
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.plate import plate_force
from softness_bayes.touch.readings import ALTERNATIVES, MENDED, NAMED_READINGS
from softness_bayes.touch.receptors import receptor_current, receptors_within
from softness_bayes.touch.skin import DISPLACEMENT, STRAIN
from softness_bayes.touch.stress import PRINCIPAL
from support.pages import (
    blocks,
    headings,
    holds,
    in_the_code,
    numbers,
    paragraphs,
    plain,
    sections,
    starting,
    table,
    tables,
    value,
)

PAGE = "model.md"
UNITS = {"mm": 1e-3, "kPa": 1e3, "N mm": 1e-3}
FINGER = Finger(radius=7e-3, poisson_ratio=0.43)


def readings_of(place):
    """Return the rows of the table of a place's readings, by name."""
    (found,) = [t.rows for t in tables(PAGE) if t.lead.startswith(f"Readings of `{place}`")]
    return {plain(row["reading"]): row for row in found}


def equation_of(place, name, column):
    return plain(readings_of(place)[name][column])


def prose(section):
    return " ".join(sections(PAGE)[section].split())


# names


def test_sections_are_numbered_in_order():
    assert [*headings(PAGE)] == [str(k) for k in range(1, 14)]


@pytest.mark.parametrize("place", ALTERNATIVES)
def test_readings_and_their_default(place):
    rows = readings_of(place)
    assert [*rows] == [*ALTERNATIVES[place]]
    assert ["★" in row["reading"] for row in rows.values()] == [True, *[False] * (len(rows) - 1)]


def test_named_sets_of_readings():
    rows = table(PAGE, "", "set")
    assert [plain(row["set"]) for row in rows] == [*NAMED_READINGS]
    for row, readings in zip(rows, NAMED_READINGS.values(), strict=True):
        said = dict(part.split("=") for part in re.findall(r"`(\w+=[\w-]+)`", row["departs from the defaults in"]))
        assert {**MENDED.names, **said} == readings.names
        assert ("★" in row["set"]) == (readings == MENDED)


def test_scales_and_directions():
    rows = {plain(row["reading"]): row for row in table(PAGE, "9", "reading", "ratings")}
    assert [*rows] == [*RATING_SCALES]
    for name, row in rows.items():
        assert tuple(re.findall(r"`(\w+)`", row["parameters"])) == rating_model(RATING_SCALES[name]).needs
    rows = {plain(row["reading"]): row for row in table(PAGE, "9", "reading", "sign")}
    assert [*rows] == [*RATING_DIRECTIONS]
    for name, row in rows.items():
        assert float(f"{row['sign']}1") == RATING_DIRECTIONS[name].sign
        assert plain(row["former name"]) == RATING_DIRECTIONS[name].former


def test_claims():
    rows = table(PAGE, "11", "claim")
    assert [(plain(row["claim"]), row["the paper says"]) for row in rows] == [(c.name, c.statement) for c in CLAIMS]
    for row, claim in zip(rows, CLAIMS, strict=True):
        # 1 GPa, 5 %, 10 %, 0 to 30 mm: the same numbers, whatever the words
        assert {*re.findall(r"\d+", row["criterion"])} >= {*re.findall(r"\d+", claim.criterion)}


# numbers


@pytest.mark.parametrize(
    ("path", "cell", "unit"),
    [
        (plain(r["in the code"]), r["value"], r.get("unit", ""))
        for t in tables(PAGE)
        for r in t.rows
        if "in the code" in r
    ],
)
def test_constants(path, cell, unit):
    assert_allclose(np.multiply(numbers(cell), UNITS.get(unit, 1.0)), np.ravel(in_the_code(path)), rtol=1e-12)


def test_parameters_and_their_priors():
    rows = {plain(row["parameter"]): row for row in table(PAGE, "10", "parameter")}
    assert [*rows] == [*EVERY_PARAMETER]
    for name, row in rows.items():
        declared = EVERY_PARAMETER[name]
        assert row["unit"] == declared.unit
        assert parse_prior(plain(row["default prior"])) == declared.prior, name
        assert row["meaning"].split(";")[0] == declared.meaning
        assert (f"held at {HELD[name]:g}" if name in HELD else "held") in row["meaning"] or name not in HELD
        low, high = (float(end) for end in row["range"].removeprefix("0, or ").split(" to "))
        assert (low, high, row["range"].startswith("0, or")) == (
            declared.range.low,
            declared.range.high,
            declared.range.zero,
        ), name


def test_laws_are_all_named():
    (line,) = [part for part in paragraphs(sections(PAGE)["10"]) if part.startswith("A law is written")]
    assert {*re.findall(r"`(\w+)\(", line)} == {*LAWS}


def test_prior_sets():
    displacements = {displacement.name: displacement for displacement in (STRAIN, DISPLACEMENT)}
    rows = table(PAGE, "10", "set")
    said = {}
    for row in rows:
        laws = {plain(title): parse_prior(plain(row[title])) for title in [*row][2:] if row[title]}
        said[plain(row["set"]), displacements[plain(row["`skin_displacement`"])]] = laws
    known = {(name, d): dict(laws) for name, each in PRIOR_SETS.items() for d, laws in each.items()}
    assert said == known


def test_units_of_stiffening():
    for name, row in readings_of("skin_displacement").items():
        assert row["unit of `m`"] == ALTERNATIVES["skin_displacement"][name].exponent_unit


def test_level_of_ratings():
    level = RatingModel().level
    assert np.exp(level.mean) == pytest.approx(20)
    assert level.sd == 3


# equations


@pytest.mark.parametrize("name", ALTERNATIVES["fabric_modulus"])
def test_fabric(name, rng):
    tensile, thickness, nu = rng.uniform(1e6, 1e8, 5), rng.uniform(1e-4, 2e-3, 5), rng.uniform(0.0, 0.45, 5)
    reading = ALTERNATIVES["fabric_modulus"][name]
    rigidity = reading.rigidity(tensile, thickness, nu)
    holds(equation_of("fabric_modulus", name, "bending rigidity"), D=rigidity, E_ten=tensile, h=thickness, nu_fab=nu)
    cloth = Fabrics(tuple("abcde"), tensile_modulus=tensile, thickness=thickness, poisson_ratio=nu)
    holds(starting(PAGE, "1", "E_fab"), E_fab=cloth.modulus(reading), D=rigidity, l=1e-3)


@pytest.mark.parametrize("load", [Indentation(1.3e-3), Force(0.9)], ids=str)
@pytest.mark.parametrize("displacement", [STRAIN, DISPLACEMENT], ids=lambda one: one.name)
def test_skin_and_contact(load, displacement, rng):
    b, m = rng.uniform(5e3, 2e5, 6), rng.uniform(0.2, 5, 6) * (1.0 if displacement is STRAIN else 300.0)
    fabric, nu = np.geomspace(1e3, 1e8, 6), rng.uniform(0.0, 0.45, 6)
    found = solve_contact(fabric, nu, load, b, m, FINGER, displacement)
    a, radius = found.radius, FINGER.radius
    known = {
        **{"E_skin": found.skin_modulus, "E_star": found.reduced_modulus, "a": a, "delta": found.indentation},
        **{"F": found.force, "E_fab": fabric, "nu_fab": nu, "nu_skin": FINGER.poisson_ratio, "R": radius},
        **{"b": b, "m": m, "g": a**displacement.power / radius},
    }
    (k,) = re.findall(r"`k = ([^`]+)`", prose("2"))
    known["k"] = value(k, **known)
    u = equation_of("skin_displacement", displacement.name, "compression").partition("=")[2]
    known["u"] = value(u, **known)
    for start in ("E_skin", "ln(E_skin)"):
        holds(starting(PAGE, "2", start), **known)
    for start in ("1 / E_star", "a =", "F ="):
        holds(starting(PAGE, "3", start), **known)


@pytest.mark.parametrize("name", ALTERNATIVES["pressure"])
def test_pressure(name):
    r, modulus, a = np.linspace(0, 2.9e-3, 8), 2e5, 3e-3
    known = {"r": r, "E_star": modulus, "a": a, "R": FINGER.radius, "kappa": 2.67e-3}
    if name == "printed":
        known = {"r": 1e3 * r, "E_star": 1e-6 * modulus, "a": 1e3 * a, "R": 1e3 * FINGER.radius}
    row = re.findall(r"`([^`]+)`", readings_of("pressure")[name]["pressure"])
    force = row[-1] if name == "printed" else starting(PAGE, "3", "F =")
    known["F"] = value(force.partition("=")[2], **known)
    expected = value(row[0].partition("=")[2], **known) * (1e6 if name == "printed" else 1.0)
    found = ALTERNATIVES["pressure"][name](r, modulus, a, FINGER)
    assert_allclose(found, expected, rtol=1e-9)


def test_principal_stress(rng):
    x, z, shear = rng.normal(size=(3, 9))
    holds(
        equation_of("stress_component", "principal", "stress that drives the receptor"),
        sigma=PRINCIPAL.select(x, z, shear),
        sigma_x=x,
        sigma_z=z,
        tau_xz=shear,
    )


def test_transduction():
    sigma = np.linspace(0, 40, 9)
    found = receptor_current(sigma, 20.3, 0.6, 9.0)
    holds(starting(PAGE, "6", "I ="), I=found, sigma=sigma, alpha=20.3, beta=0.6, sigma_0=9.0)


def test_membranes():
    for name, row in readings_of("membrane").items():
        membrane = MEMBRANES[name]
        currents = ("g_Na", "g_K", "g_L", "g_A", "E_Na", "E_K", "E_L", *(["E_A"] if row["E_A"] != "–" else []))
        for title in currents:
            assert float(row[title]) == getattr(membrane, title.lower()), (name, title)
        assert (row["E_A"] == "–") == (membrane.gating.a_current is None)


def gate_rates(source, voltage):
    """Return opening and closing rates of m, h and n as the page's table has them."""
    rows = table(PAGE, "7", "rate")
    return {plain(row["rate"]): rate_of(row, source, voltage) for row in rows}


def rate_of(row, source, voltage):
    scale, offset, width = (float(row[f"{name} ({source})"]) for name in ("scale", "offset", "width"))
    known = {"scale": scale, "offset": offset, "V": voltage, "y": (voltage + offset) / width}
    return value(plain(row["form"]), **known)


@pytest.mark.parametrize("name", MEMBRANES)
def test_gating(name):
    voltage = np.linspace(-90.3, 50.7, 40)
    gating = MEMBRANES[name].gating
    opening, total = gating.rates(voltage)
    row = readings_of("membrane")[name]
    rates = gate_rates(row["rates of m, h, n"], voltage)
    for gate in "mhn":
        k = gating.names.index(gate)
        assert_allclose(opening[k], rates[f"{gate}_open"], rtol=1e-9)
        assert_allclose(total[k], rates[f"{gate}_open"] + rates[f"{gate}_close"], rtol=1e-9)
    if gating.a_current is not None:
        for gate in "AB":
            k = gating.names.index(gate)
            holds(starting(PAGE, "7", f"{gate}_inf"), V=voltage, **{f"{gate}_inf": opening[k] / total[k]})
            holds(starting(PAGE, "7", f"tau_{gate}"), V=voltage, **{f"tau_{gate}": 1 / total[k]})


def firing_on_the_page():
    """Return rheobase, rate just above it and rate at 20.3 µA/cm² by membrane."""
    rows = {plain(row["membrane"]): [*row.values()][1:] for row in table(PAGE, "7", "membrane")}
    return {name: tuple(map(float, cells)) for name, cells in rows.items()}


def test_firing_at_the_papers_largest_current():
    said = firing_on_the_page()
    assert [*said] == [*MEMBRANES]
    for name, (_, _, rate) in said.items():
        found = firing_rate(np.array([20.3]), PAPER_CHANNELS, MEMBRANES[name])
        assert found == pytest.approx([rate], abs=5e-3)


@pytest.mark.parametrize(
    "name", [name if name == CONNOR_STEVENS.name else pytest.param(name, marks=pytest.mark.slow) for name in MEMBRANES]
)
def test_where_firing_begins(name):
    rheobase, rate, _ = firing_on_the_page()[name]
    begin = onset(PAPER_CHANNELS, MEMBRANES[name])
    assert begin.rheobase == pytest.approx(rheobase, abs=5e-4)
    assert begin.rate == pytest.approx(rate, abs=5e-3)
    if not rate:
        assert f"{begin.prefactor:.2f} Hz times the root" in prose("7")


@pytest.mark.parametrize("name", ALTERNATIVES["receptor_density"])
def test_receptor_density(name):
    row, density = readings_of("receptor_density")[name], ALTERNATIVES["receptor_density"][name]
    x = np.linspace(0, 30e-3, 20_001)
    base, scale, s = (numbers(row[title])[0] for title in ("base", "scale", "s"))
    # in cm, as the densities are
    per_area = value(plain(row["density"]), base=base, scale=scale, s=s / 10, x=100 * x)
    assert_allclose(density.at(x) / 1e4, per_area, rtol=1e-9)
    assert receptors_within(1.0, Finger(), density) == pytest.approx(numbers(row["receptors of the pad"])[0], abs=0.05)
    mean = np.trapezoid(density.at(x), x) / x[-1] / 1e4
    assert mean == pytest.approx(41.605 if name == "consistent" else 22.0, abs=0.03)
    if name == "consistent":
        assert density.at(np.array(0.0)) / 1e4 == pytest.approx(70.225)


@pytest.mark.parametrize("displacement", [STRAIN, DISPLACEMENT], ids=lambda one: one.name)
def test_force_of_a_plate(displacement):
    depth, b, m = np.array([5e-4, 1e-3, 2e-3]), 2e4, 3.0
    a = np.sqrt(FINGER.radius * depth)
    force = plate_force(depth, b, m, FINGER, displacement)
    known = {"F": force, "b_j": b, "m_j": m, "a": a, "R": FINGER.radius, "nu_skin": FINGER.poisson_ratio}
    holds(starting(PAGE, "9", "ln(F)"), g=a**displacement.power / FINGER.radius, e=0.0, **known)


def test_a_changed_equation_is_noticed():
    """Negative control: what evaluates the page tells one equation from another."""
    known = {"a": 3e-3, "E_star": 2e5, "R": 8e-3}
    force = value("4 E_star a³ / (3 R)", **known)
    assert force == pytest.approx(4 * 2e5 * 27e-9 / 24e-3)
    holds("F = 4 E_star a³ / (3 R)", F=force, **known)
    for other in ("F = 4 E_star a² / (3 R)", "F = 4 E_star a³ / 3 R", "F = 4 E_star a³ / (3 + R)"):
        with pytest.raises(AssertionError):
            holds(other, F=force, **known)
    assert len(blocks(PAGE, "3")) == 3
