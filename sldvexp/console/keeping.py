"""Views of a scan that is over, of which the next one keeps those that nobody has aimed anew.

A kept view's lines are copied into the folder of the next run before it scans; nothing of the run
that measured them is moved or changed, so that it can go on, and be reported, as before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import JOURNAL
from sldvexp.console.marks import AimedMark, Name
from sldvexp.errors import UserError
from sldvexp.session.journal import adopt_view, require_same
from sldvexp.session.session import measured_by, measured_from


@dataclass(frozen=True, eq=False)
class EarlierScan:
    """What there is of a scan that is over.

    Parameters
    ----------
    folder : Path
        Of its run.
    experiment : Experiment
        With which it was measured.
    whole, begun : tuple of str
        Views of which everything is there, and of which anything is.
    marks : mapping
        Of every view, as they were then.
    """

    folder: Path
    experiment: Experiment
    whole: tuple[str, ...]
    begun: tuple[str, ...]
    marks: Mapping[str, Mapping[Name, AimedMark]]

    def changed(self, view: str, marks: Mapping[Name, AimedMark]) -> bool:
        """Tell whether a view is aimed otherwise now."""
        return dict(self.marks.get(view, {})) != dict(marks)


@dataclass(frozen=True)
class ScanAhead:
    """Views that the next scan takes.

    Parameters
    ----------
    anew, first, keep : list of str
        Those that were scanned before, those that were not, and those that are kept.
    """

    anew: list[str] = field(default_factory=list)
    first: list[str] = field(default_factory=list)
    keep: list[str] = field(default_factory=list)

    @property
    def label(self) -> str:
        """What the button says that begins it.

        Examples
        --------
        >>> ScanAhead(["3"], ["5"], ["1", "2"]).label, ScanAhead(first=["1", "2"]).label
        ('Scan view 3 anew and view 5, keep 1, 2', 'Scan')
        >>> ScanAhead(anew=["1", "2"]).label
        'Scan all views anew'
        """
        if not self.keep and not self.first:
            return "Scan all views anew" if self.anew else "Scan"
        anew = f"{_views(self.anew)} anew" if self.anew else ""
        if not self.keep and not anew:
            return "Scan"
        each = " and ".join(filter(None, [anew, _views(self.first)]))
        return f"Scan {each}" + (f", keep {', '.join(self.keep)}" if self.keep else "")


def scan_ahead(
    views: Sequence[str], marks: Mapping[str, Mapping[Name, AimedMark]], last: EarlierScan | None
) -> ScanAhead:
    """Say what a scan of these views keeps of the last one; nothing if all would be kept."""
    if last is None:
        return ScanAhead(first=list(views))
    keep = [v for v in views if v in last.whole and not last.changed(v, marks.get(v, {}))]
    keep = [] if len(keep) == len(views) else keep
    rest = [view for view in views if view not in keep]
    anew = [view for view in rest if view in last.begun]
    return ScanAhead(anew, [view for view in rest if view not in anew], keep)


@dataclass(frozen=True, eq=False)
class KeptViews:
    """Views that a run takes over from another one.

    Parameters
    ----------
    source : EarlierScan
    views : list of str

    Raises
    ------
    UserError
        If they would be measured otherwise by now.
    """

    source: EarlierScan
    views: list[str]
    experiment: Experiment

    def __post_init__(self) -> None:
        for view in self.views:
            if _measured(self.source.experiment, view) != _measured(self.experiment, view):
                raise UserError(
                    f"view {view} was scanned with another configuration than the files give by "
                    "now; choose to scan every view anew"
                )

    def copy_to(self, folder: Path) -> None:
        """Copy their lines into a run's folder, before it scans."""
        journal = folder / JOURNAL
        require_same(journal, measured_by(self.experiment), measured_from(self.experiment))
        for view in self.views:
            adopt_view(journal / view, self.source.folder / JOURNAL / view)

    @property
    def told(self) -> str:
        """Sentence of what is kept."""
        return f"{_views(self.views)} of {self.source.folder}"


def _measured(experiment: Experiment, view: str) -> str:
    """Write what decides what is measured in a view."""
    e: Any = experiment
    parts = [replace(part, views={view: part.views[view]}) for part in e.scan.parts(view)]
    return repr((measured_by(replace(e, scan=parts)), measured_from(e)))


def _views(names: Sequence[str]) -> str:
    """Name views in a sentence; empty if there are none."""
    return f"view{'s' * (len(names) > 1)} {', '.join(names)}" if names else ""
