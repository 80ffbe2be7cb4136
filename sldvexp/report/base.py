"""The contract of reports, pages that are made of datasets alone after these are safe.

Also `report=none`, which makes none, and the notes of a run's stages, which every report tells.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sldvexp.config.registry import register
from sldvexp.dataset import VERDICT, Finding, RunData, findings_of
from sldvexp.errors import UserError
from sldvexp.telling import YELLOW, tell

log = logging.getLogger(__name__)

#: Name of the page in the folder of a run or sweep.
REPORT_FILE = "report.html"


@dataclass
class Report(ABC):
    """A page about a run, and one about a sweep.

    Parameters
    ----------
    each_run : bool
        Whether each run of a sweep gets a page of its own, also those that are done already; the
        sweep always has one.

    Examples
    --------
    >>> class Title(Report):
    ...     def of_run(self, path: Path) -> Path:
    ...         page = path.with_name(REPORT_FILE)
    ...         page.write_text(f"<title>{path}</title>")
    ...         return page
    ...     def of_sweep(self, path: Path, ranking: Sequence[Mapping[str, Any]]) -> None:
    ...         return None
    >>> Title().of_sweep(Path("sweep.nc"), [])
    """

    each_run: bool = False

    @abstractmethod
    def of_run(self, path: Path) -> Path | None:
        """Make the page of a run.

        Parameters
        ----------
        path : Path
            Its dataset, ``run.nc``; the page is put beside it.

        Returns
        -------
        Path or None
            Of the page, if there is one.
        """

    def of_run_at_hand(self, path: Path, run: RunData) -> Path | None:
        """Make the page of a run of which this process still has what it wrote.

        Reading hundreds of variables back takes as long as drawing half of the figures; a kind of
        report that reads the file all the same need not know of this.

        Parameters
        ----------
        path : Path
            As in `of_run`.
        run : RunData
            What the file holds.

        Returns
        -------
        Path or None
            Of the page, if there is one.
        """
        return self.of_run(path)

    def of_unfinished(self, folder: Path, reason: str = "") -> Path | None:
        """Make the page of a run that was interrupted or failed, and has no dataset.

        Parameters
        ----------
        folder : Path
            Of the run; the page is put there.
        reason : str
            The sentence that it ended with.

        Returns
        -------
        Path or None
            Of the page, if there is one: a kind of report need not have one.
        """
        return None

    @abstractmethod
    def of_sweep(self, path: Path, ranking: Sequence[Mapping[str, Any]]) -> Path | None:
        """Make the page of a sweep.

        Parameters
        ----------
        path : Path
            Its dataset, ``sweep.nc``; the page is put beside it.
        ranking : sequence of mapping
            Every run's settings, state and headline, the best first.

        Returns
        -------
        Path or None
            Of the page, if there is one.
        """


def attempt(make: Callable[[], Path | None], dataset: Path) -> list[Path]:
    """Make a page; what goes wrong is told in a sentence, for the dataset is safe already.

    Parameters
    ----------
    make : callable
        Makes the page, if there is to be one, and tells where it lies.
    dataset : Path
        What the page is about.

    Returns
    -------
    list of Path
        The page, or nothing.

    Examples
    --------
    >>> attempt(lambda: Path("report.html"), Path("run.nc"))
    [PosixPath('report.html')]
    """
    try:
        page = make()
    except Exception as error:  # whatever it is, it must not cost the run
        told = str(error) if isinstance(error, UserError) else f"{type(error).__name__}: {error}"
        log.info("the report failed", exc_info=True)
        tell(
            f"report: was not made ({' '.join(told.split())}); the results are whole in "
            f"{dataset}, and sldvexp report {dataset} tries again",
            YELLOW,
        )
        return []
    return [page] if page else []


@register("report", "none")
@dataclass
class NoReport(Report):
    """No page; `sldvexp report` makes one of the dataset later."""

    def of_run(self, path: Path) -> None:
        """Make nothing, see `Report.of_run`."""

    def of_sweep(self, path: Path, ranking: Sequence[Mapping[str, Any]]) -> None:
        """Make nothing, see `Report.of_sweep`."""


#: What a verdict means, for people.
MEANING = {
    "trusted": "nothing that could be tested speaks against the results and their bounds",
    "doubtful": "the bounds may be too small",
    "void": "the bounds cannot be believed",
}


def verdict_text(run: RunData) -> tuple[str, list[Finding]]:
    """Say the run's verdict in a line, and what it rests on.

    Returns
    -------
    str
        For example ``void: the bounds cannot be believed``; empty if the run has no verdict.
    list of Finding
        The worst first.

    Examples
    --------
    >>> from sldvexp.dataset import Severity, findings_to_dataset
    >>> sign = Finding("sign", "view left", "view left has the wrong sign", Severity.void)
    >>> line, found = verdict_text(RunData({"verdict": findings_to_dataset([sign])}))
    >>> line, found[0].text
    ('void: the bounds cannot be believed', 'view left has the wrong sign')
    """
    if VERDICT not in run.groups:
        return "", []
    verdict = str(run.groups[VERDICT].attrs["verdict"])
    return f"{verdict}: {MEANING[verdict]}", findings_of(run.groups)


def notes(run: RunData) -> list[str]:
    """List every note once; one that is not of all results names those that it is of.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> pose = group("pose", {"view": ["front"]}, s=[0.2]).assign_attrs(notes="few points")
    >>> notes(RunData({"pose": pose}))
    ['few points']
    """
    results = [n for n in run.groups if n in ("point", "field") or n.startswith("compare/")]
    found: dict[str, list[str]] = {}
    for name, group in run.groups.items():
        for note in filter(None, str(group.attrs.get("notes", "")).splitlines()):
            found.setdefault(note, []).append(name)
    told = []
    for note, of in found.items():
        named = set(of) <= set(results) and len(of) < len(results)
        which = ", ".join(name.removeprefix("compare/") for name in of)
        told.append(f"{which}: {note}" if named else note)
    return told
