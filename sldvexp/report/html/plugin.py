"""`report=html`: one self-contained page, `report.html`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sldvexp.registry import register
from sldvexp.report.base import REPORT_FILE, Report


@register("report", "html")
@dataclass
class Html(Report):
    """One file that opens offline in any browser, with the field as a shape that moves."""

    def of_run(self, path: Path) -> Path:
        """Make the page of a run, see `Report.of_run`."""
        from sldvexp.report.html.run_page import write

        return write(path, path.with_name(REPORT_FILE))

    def of_sweep(self, path: Path, ranking: Sequence[Mapping[str, Any]]) -> Path:
        """Make the page of a sweep, see `Report.of_sweep`."""
        from sldvexp.report.html.sweep_page import write

        return write(path, ranking, path.with_name(REPORT_FILE))
