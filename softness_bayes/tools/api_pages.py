"""Builder of the HTML site of guide and API reference: ``python -m softness_bayes.tools.api_pages DIR``.

The guide is built from the README and the pages in ``docs``, the reference from the docstrings. Run it in a clone. It
needs pdoc, which the extra ``dev`` installs. Any pdoc warning, such as an unknown name or a docstring that does not
parse, stops the build.
"""

from __future__ import annotations

import argparse
import gc
import pkgutil
import warnings
from importlib import import_module
from pathlib import Path

import softness_bayes
from softness_bayes.tools import guide

TEMPLATES = Path(__file__).parent / "templates"


def modules() -> list[str]:
    """Return the names to pass to pdoc: all modules except those of the command line, which has its own help.

    pdoc hides the modules of a package that lists its public names, so these are named explicitly. It finds the
    modules of other packages itself.
    """
    root = softness_bayes.__name__
    names = (module.name for module in pkgutil.walk_packages(softness_bayes.__path__, f"{root}."))
    documented = [name for name in names if name.split(".")[1] != "cli"]
    return [root, *(name for name in documented if hasattr(import_module(name.rpartition(".")[0]), "__all__"))]


def build(directory: Path) -> None:
    """Write the pages of the guide and of every module into a directory.

    Parameters
    ----------
    directory
        Output directory; created if it does not exist.

    Raises
    ------
    Warning
        If pdoc warns of anything.
    FileNotFoundError
        If a page of the guide links to a file that does not exist.
    ValueError
        If a link of the guide has no target.
    """
    import pdoc

    gc.disable()  # nearly all that is made stays until the end: to look for garbage takes a seventh of the time
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # pdoc evaluates annotations, but names imported only for type checking are undefined at run time
        warnings.filterwarnings("ignore", "Error parsing type annotation")
        # pdoc inspects a module's attributes, but the package's are imported only on first use
        vars(softness_bayes).update({name: getattr(softness_bayes, name) for name in softness_bayes.__all__})
        pdoc.render.configure(
            docformat="numpy",
            show_source=False,
            footer_text=softness_bayes.__version__,
            template_directory=TEMPLATES,
        )
        pdoc.pdoc(*modules(), output_directory=directory)
        reference = {path.relative_to(directory).as_posix() for path in directory.rglob("*.html")}
        guide.build(directory, reference, pdoc.render.env.get_template("guide.html.jinja2").render)
        guide.lead_to_guide(directory, reference)


def main() -> None:
    """Build the pages into the given directory."""
    parser = argparse.ArgumentParser(description="Build the guide and the API reference.")
    parser.add_argument("directory", type=Path, metavar="DIR", help="directory to write to")
    directory = parser.parse_args().directory
    build(directory)
    print(f"{directory / 'index.html'}: written")


if __name__ == "__main__":
    main()
