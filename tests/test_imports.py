"""Imports without what is not used: a run's figures need no ArviZ."""

import subprocess
import sys


def test_figures_of_a_run_import_no_arviz():
    code = (
        "import sys, numpy as np; from softness_bayes.base.arviz_bridge import without\n"
        "with without('arviz', 'corner'): import corner\n"
        "corner.corner(np.random.default_rng(1).normal(size=(500, 2)), labels=['a', 'b']); "
        "print('arviz' in sys.modules, 'matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"], done.stderr
