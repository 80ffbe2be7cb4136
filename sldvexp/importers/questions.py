"""Questions that the files of several views leave open, each with the setting that answers it.

A setting that a view may have for itself is named as the view's if some of the views need it: said
of all, it would win over what the files of the others state. Points that not all views have are
asked about with the rest.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.importers.incomplete import REMEDY
from sldvexp.importers.point_names import called
from sldvexp.io.questions import Question, Questions
from sldvexp.typing import Array, BoolArray, IntArray

#: Settings that a view may have for itself.
OF_VIEW = ("quantity", "unit", "length_unit", "amplitude", "reference")


def key_of_view(view: str, setting: str) -> str:
    """Name a setting of one view."""
    return f"instrument.views.{view}.{setting}"


def _override(view: str, setting: str, value: str) -> str:
    """Write a setting of one view as the command line has it."""
    if re.fullmatch(r"\w+", view, re.ASCII):
        return f"{key_of_view(view, setting)}={value}"
    return f"instrument.views={{'{view}': {{{setting}: {value}}}}}"


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Points of a view's file, and which of them it has measured.

    Parameters
    ----------
    name, source : str
        Of the view and of its file.
    node : ndarray of int, shape (point,)
        Ascending.
    missing : ndarray of bool, shape (point,)
        Where zeros stand for what was not measured.
    frequency : ndarray or None, shape (frequency,), Hz
        None as long as it is asked for.
    said : dict of int to str
        Where a file says that a point was not measured, by its place in `node`.
    has_std : bool
        Whether standard errors of its velocities are known.
    names : dict of int to str
        Of nodes, where the file has names.
    """

    name: str
    source: str
    node: IntArray
    missing: BoolArray
    frequency: Array | None = None
    said: dict[int, str] = field(default_factory=dict)
    has_std: bool = False
    names: dict[int, str] = field(default_factory=dict)

    @property
    def measured(self) -> IntArray:
        """Nodes that were measured."""
        return self.node[~self.missing]


class ViewQuestions(Questions):
    """Questions of an import.

    Parameters
    ----------
    views : iterable of str
        Names of all views.
    joined : collection of str
        Names of the views that must have measured the same points.
    for_field : bool
        Whether standard errors are needed.

    Examples
    --------
    >>> questions = ViewQuestions(["front", "left"])
    >>> questions.of("left").ask("a.uff", "unit", "mm", "the unit of its values")
    >>> questions.texts()  # doctest: +NORMALIZE_WHITESPACE
    ['a.uff: does not state the unit of its values; say it with instrument.views.left.unit, for
     example instrument.views.left.unit=mm']
    """

    def __init__(
        self, views: Iterable[str] = (), joined: Collection[str] = (), for_field: bool = False
    ) -> None:
        super().__init__()
        self._views, self._joined, self._for_field = list(views), joined, for_field
        self._view = ""
        self._seen: list[SeenPoints] = []

    def of(self, view: str) -> ViewQuestions:
        """Give the same questions, for those of one view to be noted in."""
        own = copy(self)
        own._view = view
        return own

    def ask(self, where: str | Path, setting: str, example: str, what: str, also: str = "") -> None:
        """Note something that a file does not state, once for all files that do not.

        Parameters
        ----------
        also : str
            Another way on than the setting.
        """
        text = f"does not state {what}; say it with instrument.{setting}{also}, for example "
        text += f"instrument.{setting}={example}"
        self.note(UserError(f"{where}: {text}"), where, setting, example)

    def note(
        self, error: UserError, where: str | Path, setting: str = "", example: str = ""
    ) -> Question:
        """Note an error that a setting answers; `where` is the file that its text begins with."""
        question = super().note(error, where, setting)
        question.example = example
        question.views.append(self._view)
        return question

    def saw(self, points: SeenPoints) -> None:
        """Note which points a view has, for what is asked of all views together."""
        self._seen.append(points)

    def texts(self) -> list[str]:
        """List the questions, each with the place that it is about."""
        return [question.asked(self._named(question)) for question in self._open.values()]

    def done(self) -> None:
        """Raise one `UserError` if anything is open."""
        for seen in self._seen if self._for_field else []:
            if not seen.has_std:
                self.note(no_errors(seen.source), seen.source)
        for error in (other_frequencies(self._seen), self._lacking()):
            if error is not None:
                self.note(error, str(error).partition(": ")[0])
        try:
            super().done()
        except UserError as error:
            of_all = [q.setting for q in self._open.values() if self._may_differ(q)]
            if not of_all:
                raise
            each = key_of_view(self._views[0], of_all[0])
            message = f"{error}; where views differ, say it of each, as with {each}"
            raise UserError(message) from None

    def _lacking(self) -> UserError | None:
        """Ask about points that not all views have that are joined, unless it was asked."""
        joined = [seen for seen in self._seen if seen.name in self._joined]
        return None if self.asked("incomplete") else lacking(joined)

    def _may_differ(self, question: Question) -> bool:
        """Tell whether all of several views need a setting that each may have for itself."""
        needed = set(question.views) == set(self._views)
        return question.setting in OF_VIEW and len(self._views) > 1 and needed

    def _named(self, question: Question) -> str:
        """Word a question with the setting of the views that need it, if others do not."""
        views = list(dict.fromkeys(question.views))
        if question.setting not in OF_VIEW or not 0 < len(views) < len(self._views):
            return question.text
        whole, text = f"instrument.{question.setting}", question.text
        if question.example:
            text = text.removesuffix(f"{whole}={question.example}")
        text = text.replace(whole, key_of_view(views[0], question.setting))
        if question.example:
            text += _override(views[0], question.setting, question.example)
        return text + (f" (and likewise of {', '.join(views[1:])})" if views[1:] else "")


def no_errors(source: str) -> UserError:
    """Ask for the standard errors of a file's velocities."""
    return UserError(
        f"{source}: does not state standard errors, which a field needs; say them with "
        "instrument.std, or instrument.averages if the file has coherence functions"
    )


def other_frequencies(views: Sequence[SeenPoints]) -> UserError | None:
    """Ask which frequencies are read if views have different ones."""
    known = [view for view in views if view.frequency is not None]
    for view in known:
        if not close(view.frequency, known[0].frequency):
            return UserError(
                f"{view.source}: view {view.name} has other frequencies than view {known[0].name}; "
                "choose those that all views have with instrument.frequency"
            )
    return None


def close(one: Array | None, two: Array | None) -> bool:
    """Tell whether two lists of frequencies are the same."""
    if one is None or two is None:
        return one is two
    return one.shape == two.shape and bool(np.allclose(one, two, rtol=1e-9, atol=0.0))


def lacking(views: Sequence[SeenPoints]) -> UserError | None:
    """Ask what becomes of points that not all views have measured; None if all or none have."""
    lost = lost_points(views)
    if not len(lost) or all(np.isin(view.measured, lost).all() for view in views):
        return None
    by = next(view for view in views if lost[0] not in view.measured)
    place = int(np.searchsorted(by.node, lost[0]))
    where = f", {by.said[place]}" if lost[0] in by.node and place in by.said else ""
    names = {n: own for view in views for n, own in view.names.items()}
    others = f" ({len(lost)} nodes are measured by some views only)" if len(lost) > 1 else ""
    first = called(names, int(lost[0]))
    return UserError(
        f"{by.source}{where}: the view {by.name} has not measured {first}, as others have{others}; "
        f"{REMEDY}"
    )


def lost_points(views: Sequence[SeenPoints]) -> IntArray:
    """Find the nodes that not all views have measured."""
    if not views:
        return np.empty(0, np.int64)
    whole = np.unique(np.concatenate([view.node for view in views]))
    count = sum(np.isin(whole, view.measured).astype(int) for view in views)
    return whole[count < len(views)]
