"""`report=html`: one self-contained page, `report.html`."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sldvexp.config.registry import register
from sldvexp.dataset import RunData
from sldvexp.report import html
from sldvexp.report.base import REPORT_FILE, Report


@register("report", "html")
@dataclass
class Html(Report):
    """One file that opens offline in any browser, with the field as a shape that moves."""

    def of_run(self, path: Path) -> Path:
        """Make the page of a run, see `Report.of_run`."""
        with _uncollected():
            return html.run_page.write(path, path.with_name(REPORT_FILE))

    def of_run_at_hand(self, path: Path, run: RunData) -> Path:
        """Make it of what is in memory, see `Report.of_run_at_hand`."""
        with _uncollected():
            return html.run_page.write_of(replace(run, path=path), path.with_name(REPORT_FILE))

    def of_unfinished(self, folder: Path, reason: str = "") -> Path:
        """Make the page of a run without a dataset, see `Report.of_unfinished`."""
        with _uncollected():
            return html.unfinished.write(folder, folder / REPORT_FILE, reason)

    def of_sweep(self, path: Path, ranking: Sequence[Mapping[str, Any]]) -> Path:
        """Make the page of a sweep, see `Report.of_sweep`."""
        with _uncollected():
            return html.sweep_page.write(path, ranking, path.with_name(REPORT_FILE))


@contextmanager
def _uncollected() -> Iterator[None]:
    """Put off the search for garbage: figures are many small things, and soon all done with."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
