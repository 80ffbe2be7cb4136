"""Pose of a view, and advice on the next, told while that one is scanned.

Threads of their own compute them, so that neither the scan waits nor a pose for the advice after
the view before; advice is on all views that have come by then.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.dataset import Finding, verdict_of
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import PoseResult
from sldvexp.report import with_bound

log = logging.getLogger(__name__)

Groups = Mapping[str, xr.Dataset]


@dataclass(frozen=True)
class Advice:
    """Advice on where to stand.

    Parameters
    ----------
    told : list of str
        In sentences.
    figure : callable, optional
        Draws its figure as PNG, for a narrow screen or not; called when a browser asks for it.
    """

    told: list[str]
    figure: Callable[[bool], bytes] | None = None


#: Advises from an experiment and the groups of its views that are done.
Advise = Callable[[Experiment, Groups], Advice]
MILLI = 1e3


class Afterwards:
    """Tells of views that are done.

    Parameters
    ----------
    experiment : Experiment
        Its pose method is used.
    tell : callable
        Gets the sentences of every view that is done.
    advise : callable, optional
        Says what to do next.
    planned : callable, optional
        Gets that.
    """

    def __init__(
        self,
        experiment: Experiment,
        tell: Callable[[dict[str, list[str]]], None],
        advise: Advise | None = None,
        planned: Callable[[Advice], None] | None = None,
    ) -> None:
        self._experiment, self._tell, self._advise = experiment, tell, advise
        self._planned = planned or (lambda advice: None)
        self._groups: dict[str, xr.Dataset] = {}
        self._told: dict[str, list[str]] = {}
        self._scanned: dict[str, list[str]] = {}  # of these what the scan itself says
        self._first: dict[str, str] = {}  # of these their places when they were the last
        self._work: queue.Queue[tuple[str, Groups] | None] = queue.Queue()
        self._posed: queue.Queue[Groups | None] = queue.Queue()
        self._threads = [
            threading.Thread(target=work, name=name, daemon=True)
            for work, name in ((self._do, "afterwards"), (self._do_advice, "advice"))
        ]
        for thread in self._threads:
            thread.start()

    def view_done(self, name: str, groups: Groups) -> None:
        """Take the groups of a view."""
        self._work.put((name, dict(groups)))

    def end(self) -> None:
        """Tell nothing more after what has been taken."""
        self._work.put(None)

    def join(self, seconds: float | None = None) -> None:
        """Wait until all is told, once the end is said, or so long for each thread."""
        for thread in self._threads:
            thread.join(seconds)

    def _do(self) -> None:
        while (taken := self._work.get()) is not None:
            name, groups = taken
            self._groups |= groups
            told = [line for g in groups.values() for line in _summary(g)]
            self._told[name] = self._scanned[name] = told
            self._tell(self._told)
            try:
                result = self._pose()
                if result is None:
                    continue
                for view in result.views:
                    if view in self._told:
                        first = self._first.setdefault(view, place_told(result, view))
                        told = [*sentences(result, view, first), *self._scanned[view]]
                        self._told[view] = told
                self._tell(self._told)
                self._posed.put({**self._groups, "pose": result.pose})
            except UserError as error:
                self._told[name] = [*told, f"{POSE}: not known yet, {error}"]
                self._tell(self._told)
            except Exception:
                log.exception("what is told after the view %s", name)
        self._posed.put(None)

    def _do_advice(self) -> None:
        """Advise on the views that have come last."""
        ended = False
        while not ended:
            taken = [self._posed.get()]
            while not self._posed.empty():
                taken.append(self._posed.get())
            ended = taken[-1] is None
            known = [groups for groups in taken if groups is not None]
            if not known or self._advise is None:
                continue
            try:
                self._planned(self._advise(self._experiment, known[-1]))
            except UserError as error:
                self._planned(Advice([f"{error}."]))
            except Exception:
                log.exception("advice on where to stand")

    def _pose(self) -> PoseResult | None:
        """Estimate the pose of all views that are done."""
        e = self._experiment
        if e.pose is None:
            return None
        found: PoseResult = e.pose.estimate(e.laser, e.target, self._groups)
        return found


#: How sentences on a pose begin.
POSE = "Pose"


#: Why a pose moves and becomes surer with views that are not its own.
TOGETHER = (
    "{count} views are estimated together, since the errors of the calibration object are the same "
    "in all: each tells more of them; when this view was the last, {first}"
)


def sentences(result: PoseResult, view: str, first: str = "") -> list[str]:
    """Say where the instrument stood in a view, how well that is known, and what is doubtful.

    Parameters
    ----------
    result : PoseResult
    view : str
        One of its views.
    first : str
        Where it stood, see `place_told`, as it was known when this view was the last one.
    """
    own = result.pose.sel(view=view)
    level = 100 * float(result.pose.attrs.get("confidence_level", 0.95))
    findings = [f for f in result.findings if of_view(f, view)]
    verdict = verdict_of(findings)
    place, bounded = place_told(result, view), np.isfinite(own["origin_confidence"]).all()
    told = [f"{POSE}: origin {place}{f' ({level:.0f} % bounds)' * bool(bounded)}; {verdict}"]
    if "residual_rms" in own and np.isfinite(float(own["residual_rms"])):
        told[0] += f"; residuals {float(own['residual_rms']):.2g} DAC steps"
    if first not in ("", place):
        told += [f"{POSE}: {TOGETHER.format(count=len(result.views), first=first)}"]
    return told + [f"{POSE} {f.severity.name}: {f.text}" for f in findings]


def place_told(result: PoseResult, view: str) -> str:
    """Say where the instrument stood in a view, mm, as reports do."""
    own = result.pose.sel(view=view)
    pairs = zip("xyz", own["origin"].values, own["origin_confidence"].values, strict=True)
    each = (f"{axis} {with_bound(MILLI * x, MILLI * bound)}" for axis, x, bound in pairs)
    return f"{', '.join(each)} mm"


def of_view(finding: Finding, view: str) -> bool:
    """Tell whether a finding is about a view, alone or among others, or about none in particular.

    Examples
    --------
    >>> odd = Finding("odd", "views 1, 2 and 4", "odd", views=("1", "2", "4"))
    >>> [of_view(odd, view) for view in ("2", "3")], of_view(Finding("odd", "run", "odd"), "3")
    ([True, False], True)
    """
    return not finding.views or view in finding.views


def _summary(group: xr.Dataset) -> list[str]:
    return str(group.attrs.get("summary", "")).splitlines()
