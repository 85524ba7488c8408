"""The page of the rooms is true: its list, its drawing, and every name on the way of a parameter vector."""

from __future__ import annotations

import re
import textwrap
from dataclasses import replace

import pytest

from softness_bayes.likelihood.scales import FALLS
from softness_bayes.model.scenes import touch_parameters, usual_values
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.priors import require_prior
from softness_bayes.tools.rooms import FILE, PACKAGE, drawing, floors, imports, needed
from softness_bayes.touch import stress
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Scene
from support.pages import in_the_code, text_of

ROOMS = re.findall(r"^\| \[([a-z_.]+)\]\(\.\./([a-z_/.]+)\)", text_of("architecture.md"), re.M)
MEDIAN = touch_parameters(usual_values(MENDED))


@pytest.fixture(scope="module")
def imported():
    """The rooms that each room imports, read from every module."""
    return imports()


def test_the_page_lists_every_room(imported):
    assert sorted(name for name, _ in ROOMS) == sorted(imported)
    for name, file in ROOMS:
        path = name.replace(".", "/")
        assert file in (f"{path}.py", f"{path}/__init__.py")
        assert (PACKAGE / file).is_file()


def test_the_drawing_is_of_these_imports(imported):
    assert FILE.read_text(encoding="utf-8") == drawing(imported), "run python -m softness_bayes.tools.rooms"


def test_a_drawing_of_four_rooms():
    """By hand: the import that another way implies has no line, and a room stands above all that it imports."""
    four = {"a": {"b", "c", "d"}, "b": {"d"}, "c": {"d"}, "d": set()}
    four = {name: frozenset(others) for name, others in four.items()}
    assert floors(four) == [["a"], ["b", "c"], ["d"]]
    assert needed(four) == {"a": ["b", "c"], "b": ["d"], "c": ["d"], "d": []}
    assert drawing(four).count("<polyline") == 4
    assert drawing(four).count("<text") == 4


def test_a_changed_import_is_noticed(imported):
    """Negative control."""
    assert drawing({**imported, "errors": frozenset(), "ranges": frozenset()}) != drawing(imported)


@pytest.mark.parametrize("page", ["architecture.md", "extending.md"])
def test_every_name_on_the_page_is_in_the_code(page, imported):
    first = "|".join({name.partition(".")[0] for name in imported})
    names = re.findall(rf"`((?:{first})(?:\.\w+)+)`", text_of(page))
    assert len(names) > 10
    for name in names:
        in_the_code(name)


def test_a_name_that_is_not_in_the_code_is_noticed():
    """Negative control."""
    for name in ("touch.stress.NOTHING", "touch.nothing.ATTENUATED"):
        with pytest.raises(ImportError):
            in_the_code(name)


@pytest.mark.parametrize("page", ["architecture.md", "extending.md"])
def test_every_file_on_the_page_exists(page):
    for shown, file in re.findall(r"\[([^]]+)\]\(([^)]+)\)", text_of(page)):
        path = (PACKAGE / "docs" / (file.partition("#")[0] or page)).resolve()  # a link may lead to a heading
        assert path.is_file(), file
        if "/" in shown:  # the text says which file it is
            known = shown.replace("\\", "")
            assert path.as_posix().endswith(f"/{known}"), file


def test_the_pressure_reading_of_the_page_works():
    """The example's values, put beside those of the module, make a scene that responds between its neighbours."""
    code = re.search(r"<!-- mild -->\n *```python\n(.*?)```", text_of("extending.md"), re.DOTALL)[1]
    names = dict(vars(stress))
    exec(textwrap.dedent(code), names)
    rates = [
        Scene([2e6], 0.3, [Indentation(2e-3)], FixedChannels(), readings=replace(MENDED, pressure=p)).total_rate(MEDIAN)
        for p in (stress.ATTENUATED, names["MILD"], stress.HERTZ)
    ]
    assert rates[0] < rates[1] < rates[2]


def test_the_values_of_ones_own_on_the_page_work():
    code = re.search(r"<!-- own -->\n *```python\n(.*?)```", text_of("extending.md"), re.DOTALL)[1]
    names = {"__name__": __name__}
    exec(textwrap.dedent(code), names)
    require_prior("the page's law", names["Gamma"](4, 0.05))
    assert replace(MENDED, pressure=names["MILD"]).pressure.meaning


def test_the_observation_model_of_ones_own_is_one():
    code = re.search(r"<!-- own-model -->\n```python\n(.*?)```", text_of("extending.md"), re.DOTALL)[1]
    made = {"__name__": __name__}
    exec(code, made)
    scale, model = made["AGREEMENT"], made["AGREEMENT"].model(FALLS)
    assert (model.scale, model.direction, scale.name) == (scale, FALLS, "agreement")
    assert {*model.needs} <= {*EVERY_PARAMETER}
