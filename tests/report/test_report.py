"""The report: what the page says beside what the run holds, what it loads, and what it refuses."""

from __future__ import annotations

import base64
import io
import json
import re
import shlex
from dataclasses import fields, replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.spreadsheet import table_of
from softness_bayes.base.laws import LogNormal
from softness_bayes.base.readable import chance, number
from softness_bayes.cli import main, sample
from softness_bayes.likelihood.scales import FALLS
from softness_bayes.model.options import ModelOptions
from softness_bayes.plotting.figures import figures_of
from softness_bayes.report import page
from softness_bayes.report.cards import Standing, cards
from softness_bayes.report.charts import chart_data
from softness_bayes.report.page import anonymous, renamed, report_page, shown_by, write_report
from softness_bayes.report.tables import MOST_FABRICS, repetition
from softness_bayes.results.run_options import DataFiles, Request, RunOptions
from softness_bayes.touch.readings import CLASSICAL
from support.report_runs import EVIL, OPTIONS, PERSON, RUNS, converged

VOID = {"meta", "link", "img", "input", "br"}


class Element:
    def __init__(self, tag, attributes, parent):
        self.tag, self.attributes, self.parent, self.children, self.words = tag, attributes, parent, [], []

    def all(self, tag):
        return [e for child in self.children for e in ([child] if child.tag == tag else []) + child.all(tag)]

    @property
    def text(self):
        return " ".join(" ".join(part if isinstance(part, str) else part.text for part in self.words).split())


class Tree(HTMLParser):
    """The elements of a page; a tag that is not closed where it should be is an error."""

    def __init__(self, text):
        super().__init__()
        self.here = self.root = Element("", {}, None)
        self.feed(text)
        assert self.here is self.root, f"<{self.here.tag}> is not closed"

    def handle_starttag(self, tag, attrs):
        made = Element(tag, dict(attrs), self.here)
        self.here.children.append(made)
        self.here.words.append(made)
        if tag not in VOID:
            self.here = made

    def handle_endtag(self, tag):
        assert tag == self.here.tag, f"</{tag}> inside <{self.here.tag}>"
        self.here = self.here.parent

    def handle_data(self, data):
        self.here.words.append(data)

    def by_id(self, name):
        return next(e for e in self.elements() if e.attributes.get("id") == name)

    def by_class(self, name):
        return [e for e in self.elements() if name in e.attributes.get("class", "").split()]

    def elements(self, root=None):
        for child in (root or self.root).children:
            yield child
            yield from self.elements(child)


@pytest.fixture(scope="module")
def made(report_run):
    """Return runs by name, each made once."""
    kept = {}

    def one(name):
        if name not in kept:
            kept[name] = report_run(name)
        return kept[name]

    return one


@pytest.fixture(scope="module")
def pages(made):
    """Return pages by the name of their run; figures are blank, a browser looks at real ones."""
    kept = {}

    def one(name):
        if name not in kept:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(page, "picture", blank)
                kept[name] = report_page(made(name))
        return kept[name]

    return one


def blank(result, name):
    section = page.SECTIONS.get(name, "learnt")
    return page.Picture(name, "data:image/png;base64,", f"Blank {name}.", f"Blank {name}, in words.", section)


@pytest.fixture
def quick(monkeypatch):
    """Draw no figure."""
    monkeypatch.setattr(page, "picture", blank)


@pytest.mark.parametrize("name", RUNS)
def test_a_page_is_one_file_that_is_well_formed_and_can_be_read_aloud(pages, made, name):
    text = pages(name)
    tree = Tree(text)
    elements = [*tree.elements()]
    # nothing is fetched
    for element in elements:
        for key in ("src", "href", "action", "data", "poster", "srcset"):
            value = element.attributes.get(key)
            assert value is None or value.startswith("data:"), (element.tag, key, value)
    css = next(e for e in elements if e.tag == "style").text
    assert "url(" not in css
    assert "@import" not in css
    (policy,) = [e.attributes["content"] for e in elements if e.attributes.get("http-equiv")]
    assert policy.startswith("default-src 'none'")
    # headings do not skip a level, and there is one title
    levels = [int(e.tag[1]) for e in elements if re.fullmatch("h[1-6]", e.tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert max(np.diff(levels)) <= 1
    ids = [e.attributes["id"] for e in elements if "id" in e.attributes]
    assert len(ids) == len({*ids})
    for element in elements:
        assert element.attributes.get("aria-labelledby", ids[0]) in ids
    pictures = [e for e in elements if e.tag == "img"]
    every = figures_of(made(name))
    further = [one for one in every if one in page.LEFT_OUT]
    assert len(pictures) == len(every) - len(further)
    assert f"softness-bayes plot DIR also draws {', '.join(further)}." in {e.text for e in elements if e.tag == "p"}
    assert all(len(e.attributes["alt"]) > 5 for e in pictures)
    assert {e.attributes.get("scope") for e in elements if e.tag == "th"} == {"row", "col"}
    assert next(e for e in elements if e.tag == "html").attributes["lang"] == "en"
    assert any(e.attributes.get("name") == "viewport" for e in elements)
    # every table scrolls by itself
    assert all("scroll" in e.parent.attributes["class"] for e in elements if e.tag == "table")


def test_names_are_words_and_never_markup(pages):
    text = pages("ratings")
    tree = Tree(text)
    scripts = [e for e in tree.elements() if e.tag == "script"]
    assert not any("alert" in script.text and "felt" in script.text and "{" not in script.text for script in scripts)
    assert not any("onerror" in e.attributes for e in tree.elements())
    # the charts' own data hold the name; what could end their element is written otherwise
    assert EVIL not in text
    assert PERSON not in text
    payload = json.loads(tree.by_id("payload").text)
    assert EVIL in payload["shown"]["e_fab"][0]["fabrics"]["fabric"]
    cells = {e.text for e in tree.elements() if e.tag == "td"}
    assert any(EVIL in cell for cell in cells)
    assert any(PERSON in cell for cell in cells)


def test_answers_come_first_and_unfinished_runs_are_loud(pages, made, quick):
    tree = Tree(pages("ratings"))
    assert next(e.text for e in tree.elements() if e.tag == "dt") == "Can this result be trusted?"
    headings = [e.text for e in tree.elements() if e.tag == "h2"]
    assert headings == ["The fabrics", "What no check can show", "Verdict", "Details"]
    (alarm,) = tree.by_class("alarm")
    assert alarm.attributes["role"] == "alert"
    assert "has not converged" in alarm.text
    assert made("ratings").attributes["verdict"] in alarm.text
    assert tree.by_class("card")[0].attributes["class"] == "card bad"
    assert not tree.by_class("good")
    finished = Tree(report_page(converged(made("ratings"))))
    assert not finished.by_class("alarm")
    assert finished.by_class("card")[0].attributes["class"] == "card good"


def test_every_finding_follows_the_numbers(made):
    result = converged(made("ratings"))

    def standing(changed, question):
        return next(f for f in cards(changed) if question in f.question)

    found = cards(result)
    assert [f.standing for f in found[:2]] == [Standing.GOOD, Standing.GOOD]
    tree = result.tree.copy()
    tree.attrs["exact_enough"] = 0.0
    assert standing(replace(result, tree=tree), "accurate enough").standing is Standing.BAD
    # what was learnt is a matter of widths alone
    table = result.table.copy()
    table["contraction"] = np.where(table.index == "b", 0.2, 0.9)
    told = standing(replace(result, table=table), "inform")
    assert told.answer == f"{len(table) - 1} of {len(table)}"
    assert any(detail.startswith("Weakly identified") and detail.endswith(": b 0.89.") for detail in told.details)


def test_curves_are_quantiles_of_the_draws_on_both_axes(made):
    result = made("ratings")
    curves, found = result.curves(), chart_data(result)
    for k in range(2):
        one = found["e_fab"][k]
        assert_allclose(one.rate["x"], curves.modulus / 1e3, rtol=1e-4)
        rate = curves.total_rate[:, k]
        for name, level in {"median": 50, "low50": 25, "high50": 75, "low90": 5, "high90": 95}.items():
            assert_allclose(one.rate[name], np.percentile(rate, level, axis=0), rtol=1e-4)
        # at the fabrics' median ratio a draw's curve is where its own ratio says
        other = found["ratio"][k]
        draw = np.log(curves.modulus / curves.skin_modulus[:, k])
        at = np.log(other.rate["x"][80])
        expected = np.median([np.interp(at, x, y) for x, y in zip(draw, rate, strict=True)])
        assert other.rate["median"][80] == pytest.approx(expected, rel=1e-3, abs=1e-3)
        assert other.ends == pytest.approx(np.exp([draw[:, 0].max(), draw[:, -1].min()]))
    # mean ratings: nothing is missing here, so that geometric means are plain ones
    constant, log_rating = result.group("constant_data"), np.log(result.group("observed_data")["rating"].values)
    for k in range(2):
        for f, mean in enumerate(found["ratio"][k].fabrics["mean"]):
            rows = (constant["load_index"].values == k) & (constant["fabric_index"].values == f)
            assert mean == pytest.approx(np.exp(log_rating[rows].mean()), rel=1e-4)
    row = result.inflection().iloc[0]
    turn = found["e_fab"][0].turn
    assert turn["left"] + turn["middle"] + turn["right"] == pytest.approx(
        [row["e_fab_kpa_low"], row["e_fab_kpa"], row["e_fab_kpa_high"]], rel=1e-4
    )


def test_tables_hold_the_run_s_numbers(pages, made):
    result, tree = made("ratings"), Tree(pages("ratings"))
    head, *rows = ([cell.text for cell in row.children] for row in tree.by_id("summary").all("tr"))
    assert [row[0] for row in rows] == result.table.index.tolist()
    for row in rows:
        assert float(row[head.index("Mean")]) == pytest.approx(result.table.loc[row[0], "mean"], rel=1e-3)
        assert float(row[head.index("R-hat")]) == pytest.approx(result.table.loc[row[0], "r_hat"], rel=1e-4)
    checks = result.tables["predictive_checks"].xs("posterior", level="law")
    assert len(tree.by_id("checks").all("tr")) == len(checks) + 1
    facts = {row.children[0].text: row.children[1].text for t in tree.by_class("facts") for row in t.all("tr")}
    assert facts["Seed"] == "3"
    assert facts["numpy"] == np.__version__
    assert facts["m held at"] == "2"
    assert facts["pressure"] == "attenuated"


def test_fabrics_are_compared_load_by_load_and_the_table_can_be_taken_away(made, pages, quick):
    result, tree = made("ratings"), Tree(pages("ratings"))
    kept = result.tables["fabric_ratings"]
    head, *rows = ([cell.text for cell in row.children] for row in tree.by_id("fabrics").all("tr"))
    assert [(row[1], row[0]) for row in rows] == [*kept.index]
    for row, (_, known) in zip(rows, kept.iterrows(), strict=True):
        assert float(row[head.index("Rated")]) == pytest.approx(known["rated"], rel=5e-3)
        assert ("✱" in row[-1]) == (abs(known["difference_sd"]) >= 2)
    (link,) = [e for e in tree.elements() if e.attributes.get("download") == "fabric_ratings.csv"]
    taken = table_of(io.BytesIO(base64.b64decode(link.attributes["href"].partition(",")[2])), ["load", "fabric"])
    pd.testing.assert_frame_equal(taken, kept, check_exact=False)
    # of very many, those that differ most
    many = pd.concat([kept.assign(difference_sd=0.1 * k) for k in range(20)])
    few = Tree(report_page(replace(result, tables={**result.tables, "fabric_ratings": many})))
    assert len(few.by_id("fabrics").all("tr")) == MOST_FABRICS + 1
    assert "Shown are the 60" in few.by_id("fabrics-caption").text


def test_title_and_author_are_words(made, quick):
    tree = Tree(report_page(made("skin"), title=EVIL, author="Ann & <Bo>"))
    assert next(e for e in tree.elements() if e.tag == "h1").text == EVIL
    assert tree.by_class("author")[0].text == "Ann & <Bo>"
    assert next(e for e in tree.elements() if e.tag == "title").text.startswith(EVIL)
    assert not Tree(report_page(made("skin"))).by_class("author")


def test_a_figure_that_is_left_out_is_shown_on_request(quick, made):
    tree = Tree(report_page(made("skin"), ("trace", "prior")))
    shown = [e.attributes["id"] for e in tree.elements() if e.tag == "figure"]
    assert shown == ["figure-corner", "figure-prior", "figure-compression", "figure-rank", "figure-trace"]
    assert not [e for e in tree.elements() if "also draws" in e.text]


def test_texts_in_place_of_figures_hold_the_numbers_of_the_run(made):
    result = made("ratings")
    said = {name: " ".join(shown_by(result, name)) for name in figures_of(result)}
    row = result.inflection().iloc[0]
    assert f"turning point with probability {chance(row['p_interior'])}" in said["response"]
    rated = result.tables["fabric_ratings"].loc["2 mm", "rated"]
    assert f"to {number(rated.max())} ({rated.idxmax()})" in said["rating"]


def test_compression_alone_says_what_does_not_apply(pages, made):
    tree = Tree(pages("skin"))
    heads = [card.children[0].children for card in tree.by_class("card")]
    cards = {question.text: answer.text for question, answer in heads}
    assert cards["Does the model reproduce the turning point (maximum), where the ratings can show it?"].startswith(
        "Does not apply"
    )
    assert cards["Does the skin model reproduce the forces of the plate?"].startswith(("Yes", "No"))
    assert not tree.by_class("controls")
    assert "Bokeh" not in pages("skin")
    assert "RATINGS.csv" not in tree.by_id("repeat").text
    assert "--ratings" not in tree.by_id("repeat").text


# the command


def repeated(command, monkeypatch, directory):
    """Return the data files and options that a printed command amounts to."""
    caught = []

    def compiled(data, options):
        return SimpleNamespace(options=options, posterior=SimpleNamespace(space=SimpleNamespace(sampled=("b",))))

    def run(checkpoint, files, model, run, figures, verbose):
        caught.append((files, Request(model.options, run)))

    monkeypatch.setattr(sample, "_run", run)
    # there are no data to look at
    monkeypatch.setattr(DataFiles, "read", lambda files: None)
    monkeypatch.setattr(sample, "_compiled", compiled)
    monkeypatch.chdir(directory)
    program, *words = shlex.split(command)
    assert program == "softness-bayes"
    main(words, standalone_mode=False)
    return caught[0]


FILES = {
    "data": "r.csv",
    "fabrics": "f.csv",
    "compression": "c.csv",
    "afferents": "a.csv",
    "column": "rating=softness",
    "indentation-mm": "2",
    "force-n": "1",
    "decimal": "ratings=,",
    "load": "free",
    "round-load": "0.05",
}
ASKED = Request(ModelOptions(), RunOptions()).with_options(
    fix={"b": 1 / 3},
    priors={"m": LogNormal(2.5, 0.2)},
    prior_set="in-vivo",
    readings=CLASSICAL.override({"pressure": "attenuated"}),
    direction=FALLS,
    noise=0.25,
    exact_reweight=True,
    max_steps=123,
    seed=99,
)


def asked_for(result, request, command):
    """Return a result that says that another run was asked for."""
    tree = result.tree.copy()
    record = json.dumps(request.with_options(command=command).record())
    tree.attrs = {**tree.attrs, "options": record, "command": command}
    return replace(result, tree=tree)


def test_the_command_amounts_to_the_files_and_the_options_of_the_run(made, monkeypatch, tmp_path):
    words = [word for name, value in FILES.items() for word in (f"--{name}", value)]
    typed = shlex.join(["softness-bayes", "sample", *words, "--drop-zeros", "--wide", "--drift", "--out", "results"])
    found = repetition(asked_for(made("ratings"), ASKED, f"{typed}; softness-bayes resume results --more-steps 50"))
    first, more = found.commands
    assert more == "softness-bayes resume again/ --more-steps 50"
    files, request = repeated(first, monkeypatch, tmp_path)
    assert files == repeated(typed, monkeypatch, tmp_path)[0]
    empty = DataFiles()
    assert all(getattr(files, one.name) != getattr(empty, one.name) for one in fields(DataFiles))
    for name in ("fix", "priors", "prior_set", "readings", "direction", "scale", "noise"):
        assert getattr(request.model, name) == getattr(ASKED.model, name), name
    for name in ("exact_reweight", "seed", "max_steps"):
        assert getattr(request.run, name) == getattr(ASKED.run, name), name


def test_a_run_of_python_or_of_limited_time_says_so(made):
    limited = Request(ModelOptions(), RunOptions()).with_options(**OPTIONS | {"max_seconds": 5.0, "max_steps": 10_000})
    found = repetition(asked_for(made("ratings"), limited, ""))
    assert f"--max-steps {OPTIONS['max_steps']} " in found.commands[0]
    assert "--data RATINGS.csv" in found.commands[0]
    assert any("time limit" in note for note in found.notes)
    assert any("with a given resolution" in note for note in found.notes)


# without names


@pytest.mark.parametrize("name", ["ratings", "skin"])
def test_nobody_is_named_on_an_anonymous_page(made, quick, name):
    """Everywhere: in words, in data behind the charts, in every text of every figure."""
    result = made(name)
    group, axis = ("log_likelihood_participant", "participant") if name == "ratings" else ("posterior", "finger")
    people = result.group(group)[axis].values.tolist()
    known = renamed(result, {person: f"Zoë Quine-{k}" for k, person in enumerate(people)})
    assert ("Quine" in report_page(known)) == (name == "ratings")  # the control; of fingers a page says nothing
    nameless = anonymous(known)
    assert nameless.group(group)[axis].values.tolist() == [f"P{k}" for k in range(1, len(people) + 1)]
    assert "Quine" not in report_page(nameless)
    assert "Quine" not in str({**nameless.attributes})
    for figure in figures_of(nameless):
        words = [text.get_text() for text in nameless.plot(figure).findobj(Text)]
        assert words
        assert not [word for word in words if "Quine" in word]
    # nothing else has changed
    assert renamed(nameless, dict(zip(nameless.group(group)[axis].values, people, strict=True))).tree.identical(
        result.tree
    )
    pd.testing.assert_frame_equal(nameless.summary(), result.summary())


# the file


def test_a_page_depends_on_its_run_alone(pages, made, quick):
    """Two pages have the same bytes, although the library of the charts numbers its objects anew."""
    assert report_page(made("ratings")) == pages("ratings")


def test_only_reports_are_replaced(made, quick, tmp_path):
    result, path = made("skin"), tmp_path / "deep" / "page.html"
    assert write_report(result, path) == path
    before = path.read_text()
    write_report(result, path)
    assert path.read_text() == before  # and nothing of the day or the machine in it
    path.write_text("mine")
    with pytest.raises(InputError, match=r"page\.html was changed since it was written"):
        write_report(result, path)
    (path.parent / "thesis.html").write_text("mine")
    with pytest.raises(InputError, match=r"thesis\.html was not written by this command"):
        write_report(result, path.parent / "thesis.html")
    assert path.read_text() == (path.parent / "thesis.html").read_text() == "mine"
    with pytest.raises(InputError, match="is a directory"):
        write_report(result, tmp_path)
    assert {p.name for p in path.parent.iterdir()} == {".softness-bayes.json", "page.html", "thesis.html"}
