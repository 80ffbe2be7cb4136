"""The writers of universal files of `tests/io/uff`, for importers that read such files."""

from __future__ import annotations

import importlib.util
from pathlib import Path

WRITERS = Path(__file__).parents[1] / "io" / "uff" / "conftest.py"

_spec = importlib.util.spec_from_file_location("writers_of_universal_files", WRITERS)
_module = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_module)

uff = _module.uff
