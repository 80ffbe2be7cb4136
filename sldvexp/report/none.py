"""`report=none`: the dataset only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sldvexp.config.registry import register
from sldvexp.report.base import Report


@register("report", "none")
@dataclass
class NoReport(Report):
    """No page; `sldvexp report` makes one of the dataset later."""

    def of_run(self, path: Path) -> None:
        """Nothing, see `Report.of_run`."""

    def of_sweep(self, path: Path, ranking: Sequence[Mapping[str, Any]]) -> None:
        """Nothing, see `Report.of_sweep`."""
