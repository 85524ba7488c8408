"""Pages show what is true: commands parse, columns are known, links lead somewhere, constants are those of the code."""

from __future__ import annotations

import re
import shlex
from pathlib import PurePosixPath

import click
import pytest

from reference_pages import write_pages
from softness_bayes.base.ranges import LOAD_ERRORS
from softness_bayes.checking.inflection import LEAST_DROP
from softness_bayes.cli import VERBS, main
from softness_bayes.data.columns import NAMES
from softness_bayes.data.fabrics import USUAL_POISSON_RATIO
from softness_bayes.likelihood.lists import MOST_TIED
from softness_bayes.model import direction
from softness_bayes.touch.contact import HERTZ_LIMIT, PLATE_LENGTH, Finger
from softness_bayes.touch.finger_grid import REACH
from softness_bayes.touch.neuron.fixed_channels import LARGEST_CURRENT
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS
from softness_bayes.touch.stress import ATTENUATION
from support.command_line import call
from support.pages import DOCS, PAGES, blocks, text_of
from support.paths import DATA, ROOT

GROUP = click.Context(main, info_name="softness-bayes", **main.context_settings)
COMMANDS = {verb: main.get_command(GROUP, verb) for verb in VERBS}
OTHER_PROGRAMS = ("python", ".venv/bin/python", "dask", "COMP_WORDBREAKS", "eval", "_SOFTNESS_BAYES_COMPLETE")
"""What lines of shell begin with beside the program itself."""
THEIR_OPTIONS = {"--quiet", "--scheduler-file", "--nthreads", "--nworkers", "--measure", "--help", "--labs", "--check"}
"""Options of other programs, and of all commands, that pages name."""
LINES = [
    (page, line)
    for page, text in PAGES.items()
    for code in blocks(text, "sh")
    for line in code.replace("\\\n", " ").splitlines()
    if line.strip()
]


def parsed(line):
    """Parse a line of the command line as click does, without looking for its files; return the verb and options."""
    program, verb, *rest = shlex.split(line, comments=True)
    assert program == "softness-bayes"
    context = click.Context(COMMANDS[verb], info_name=verb, parent=GROUP)
    values, left, _ = COMMANDS[verb].make_parser(context).parse_args(rest)
    assert not left, f"left over: {left}"
    for option in COMMANDS[verb].params:
        given = values.get(option.name)
        if given is not None and not isinstance(option.type, click.Path):
            option.type_cast_value(context, given)
    return verb, values


@pytest.mark.parametrize(("page", "line"), LINES, ids=[f"{page}: {line}" for page, line in LINES])
def test_a_line_of_shell_is_one_of_the_program(page, line):
    if not line.startswith(OTHER_PROGRAMS):
        parsed(line)


@pytest.mark.parametrize("line", ["glance run/", "sample --dat x.csv", "sample --errors gaussian", "status a b"])
def test_a_wrong_line_is_noticed(line):
    """Negative control."""
    with pytest.raises((KeyError, AssertionError, click.ClickException)):
        parsed(f"softness-bayes {line}")


@pytest.mark.parametrize("page", PAGES)
def test_every_option_that_a_page_names_exists(page):
    known = {flag for command in COMMANDS.values() for option in command.params for flag in option.opts}
    text = re.sub(r"^.*(?:-m (?:pip|sphinx|pytest)|venv|softness_bayes\.tools).*$", "", PAGES[page], flags=re.MULTILINE)
    assert {*re.findall(r"(?<![\w-])--[a-z]+(?:-[a-z]+)*", text)} <= known | THEIR_OPTIONS


def test_every_block_of_python_is_run_by_a_test():
    """`test_front_page` and `test_architecture` run them by their marks."""
    marks = {mark for text in PAGES.values() for mark in re.findall(r"<!-- ([\w-]+) -->\n *```python", text)}
    assert marks == {"python", "forward", "backward", "own", "own-model", "mild"}
    assert sum(len(blocks(text, "python")) for text in PAGES.values()) == len(marks)


def test_tables_on_pages_have_columns_that_are_read():
    heads = [
        code.splitlines()[0].split(",")
        for page, text in PAGES.items()
        if page.startswith("howto/")
        for code in blocks(text, "text")
    ]
    assert len(heads) > 5
    assert {name for head in heads for name in head} - {*NAMES} == {"hand"}  # a covariate


def anchors(text):
    """Return the anchors of a page's headings, as the site and GitHub make them."""
    titles = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Every page with those that are made from declarations."""
    directory = tmp_path_factory.mktemp("site")
    write_pages(directory)
    return PAGES | {f"reference/{path.name}": path.read_text(encoding="utf-8") for path in directory.iterdir()}


def broken(page, text, site):
    """Return the links of a page that lead nowhere."""
    wrong = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        place, _, anchor = link.partition("#")
        if "://" in link:
            continue
        folder = ROOT if page == "README.md" else (DOCS / page).parent
        path = (folder / place).resolve() if place else DOCS / page
        name = path.relative_to(DOCS).as_posix() if path.is_relative_to(DOCS) else ""
        if not (path.exists() or name in site) or (anchor and name in site and anchor not in anchors(site[name])):
            wrong.append(link)
    return wrong


def test_links_lead_somewhere(site):
    assert {page: wrong for page, text in PAGES.items() if (wrong := broken(page, text, site))} == {}
    assert broken("data.md", "[a](nowhere.md) [b](files.md#no-such) [c](#files)", site) == [
        "nowhere.md",
        "files.md#no-such",
    ]


def test_every_page_is_in_the_contents_and_every_figure_has_a_text():
    listed = {"index.md", "README.md"}
    for page in ("index.md", "howto/index.md"):
        for code in blocks(PAGES[page], r"\{toctree\}"):
            names = (line for line in code.splitlines() if line and not line.startswith((":", "reference/")))
            listed |= {(PurePosixPath(page).parent / f"{name}.md").as_posix() for name in names}
    assert listed == {*PAGES}
    figures = [text for page in PAGES.values() for text in re.findall(r"!\[([^]]*)\]", page)]
    assert len(figures) >= 4
    assert all(len(text) > 20 for text in figures)


FINGER = Finger()
STATED = {
    "1. Fabric": {"`l` = {:g} mm": 1e3 * PLATE_LENGTH, "`nu_fab` = {:g}": USUAL_POISSON_RATIO},
    "3. Contact": {
        "`R` = {:g} mm": 1e3 * FINGER.radius,
        "`nu_skin` = {:g}": FINGER.poisson_ratio,
        "a > {:g} R": HERTZ_LIMIT,
    },
    "4. Pressure": {"`kappa` = {:g} N mm": 1e3 * ATTENUATION},
    "5. Stress": {"`z` = {:g} mm": 1e3 * FINGER.receptor_depth},
    "7. Neuron": {
        "`C` = {:g} µF/cm²": CONNOR_STEVENS.capacitance,
        "held ones it may reach {:g} µA/cm²": LARGEST_CURRENT,
        **{f"`{name}` = {{:g}}": value for name, value in PAPER_CHANNELS._asdict().items()},
    },
    "8. Receptors": {
        "The pad is {:g} mm long": 1e3 * FINGER.pad_length,
        "and {:g} mm wide": 1e3 * FINGER.pad_width,
        "meets it {:g} mm from its end": 1e3 * FINGER.contact_centre[0],
    },
    "9. Ratings": {
        "at most {:g}) loads": LOAD_ERRORS.high,
        "p ≤ {:g})": direction.LEVEL,
        "at least {:.0f} %": 100 * direction.SURE,
        "of {:g} prior draws": direction.DRAWS,
        "At most {} touches may tie": {6: "six"}.get(MOST_TIED),
        "to {} standard deviations": {4: "four"}.get(REACH),
    },
    "11. The paper's": {"exceeds both ends by {:g} %": 100 * LEAST_DROP},
}
"""Constants as the sections of the model's page state them, and their values in the code."""


@pytest.mark.parametrize(
    ("section", "stated", "value"), [(s, text, value) for s, texts in STATED.items() for text, value in texts.items()]
)
def test_a_constant_of_the_model_is_that_of_the_code(section, stated, value):
    text = " ".join(text_of("model.md").partition(f"## {section}")[2].partition("\n## ")[0].split())
    assert stated.format(value) in text


def test_the_tutorial_shows_what_check_prints():
    """Each line to its ellipsis; the closing lines of a whole run are not made here."""
    printed = call("check", "--data", DATA / "ratings.csv")
    lines = (printed.stdout + printed.stderr).splitlines()
    of_check = text_of("tutorial.md").partition("## 3.")[0]
    shown = [line.partition("…")[0].strip() for code in blocks(of_check, "text") for line in code.splitlines()]
    assert len(shown) > 3
    assert not [line for line in shown if not any(other.startswith(line) for other in lines)]
