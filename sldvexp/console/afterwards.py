"""Pose of a view, and advice on the next, told while that one is scanned.

A thread of its own computes it, so that the scan does not wait; views that come meanwhile are
taken together.
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
        self._waiting = 0
        self._work: queue.Queue[tuple[str, Groups] | None] = queue.Queue()
        self._thread = threading.Thread(target=self._do, name="afterwards", daemon=True)
        self._thread.start()

    def view_done(self, name: str, groups: Groups) -> None:
        """Take the groups of a view."""
        self._waiting += 1
        self._work.put((name, dict(groups)))

    def end(self) -> None:
        """Tell nothing more after what has been taken."""
        self._work.put(None)

    def join(self, seconds: float | None = None) -> None:
        """Wait until all is told, once the end is said, or so long."""
        self._thread.join(seconds)

    def _do(self) -> None:
        while (taken := self._work.get()) is not None:
            name, groups = taken
            self._waiting -= 1
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
                        self._told[view] = [*sentences(result, view), *self._scanned[view]]
                self._tell(self._told)
                if self._advise is not None and not self._waiting:
                    self._planned(
                        self._advise(self._experiment, {**self._groups, "pose": result.pose})
                    )
            except UserError as error:
                self._told[name] = [*told, f"{POSE}: not known yet, {error}"]
                self._tell(self._told)
            except Exception:
                log.exception("what is told after the view %s", name)

    def _pose(self) -> PoseResult | None:
        """Estimate the pose of all views that are done."""
        e = self._experiment
        if e.pose is None:
            return None
        found: PoseResult = e.pose.estimate(e.laser, e.target, self._groups)
        return found


#: How sentences on a pose begin.
POSE = "Pose"


def sentences(result: PoseResult, view: str) -> list[str]:
    """Say where the instrument stood in a view, how well that is known, and what is doubtful.

    Parameters
    ----------
    result : PoseResult
    view : str
        One of its views.
    """
    own = result.pose.sel(view=view)
    origin, bound = own["origin"].values, own["origin_confidence"].values
    level = 100 * float(result.pose.attrs.get("confidence_level", 0.95))
    place, mm = (
        ", ".join(f"{v:{f}}" for v in values)
        for values, f in ((origin, ".4f"), (MILLI * bound, ".2g"))
    )
    findings = [f for f in result.findings if of_view(f, view)]
    verdict = verdict_of(findings)
    sure = f"+- ({mm}) mm, {level:.0f} % bounds" if np.isfinite(bound).all() else "without bounds"
    told = [f"{POSE}: origin ({place}) m {sure}; {verdict}"]
    if "residual_rms" in own and np.isfinite(float(own["residual_rms"])):
        told[0] += f"; residuals {float(own['residual_rms']):.2g} DAC steps"
    return told + [f"{POSE} {f.severity.name}: {f.text}" for f in findings]


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
