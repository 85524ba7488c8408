"""Places of the project."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "data"
REFERENCE = ROOT / "tests" / "reference"
"""Values of other code, for use as oracles."""
SHARED = ROOT.parent / "shared"
"""Reference data beside the project, not part of it."""
