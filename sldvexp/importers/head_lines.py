"""Free text of files against what their values are read as: a contradiction is asked, or told.

Text that agrees, or that states nothing, passes in silence. A contradiction of labels, or of what
the program would take, is a question that a setting answers; a setting that somebody chose wins,
and the run is doubtful.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from sldvexp.errors import UserError
from sldvexp.importers.pointwise import PointwiseImport
from sldvexp.importers.questions import OF_VIEW, ViewQuestions
from sldvexp.io.statements import Known, Statement, distinct, shown, statement_in

#: Settings that text may contradict.
SETTINGS = ("quantity", "unit", "amplitude", "length_unit", "phase", "positive")


@dataclass
class HeadLines:
    """Comparison of lines of one view's file with what its values are read as.

    Parameters
    ----------
    settings : PointwiseImport
        Of the view.
    path : str
        Of its file.
    known : Known
    by : mapping of str to str
        Words for what is known without a setting, as a label, by the setting that would win.
    odd : list of str
        Sentences on settings that win over the text.
    """

    settings: PointwiseImport
    path: str
    known: Known
    by: Mapping[str, str]
    odd: list[str] = field(default_factory=list)
    _seen: set[tuple[str, str]] = field(default_factory=set)

    def compare(
        self,
        lines: Iterable[tuple[Callable[[], str], str]],
        questions: ViewQuestions,
        loose: bool = False,
    ) -> None:
        """Compare lines, each with a function that names its place, for a message.

        Parameters
        ----------
        loose : bool
            Whether they are about a whole file, so that the name of a quantity without its unit or
            measure may be of other functions.
        """
        for place, line in distinct(lines):
            said = statement_in(line)
            if loose and not (said.unit or said.amplitude):
                said = Statement(length=said.length, phase=said.phase, positive=said.positive)
            self._hint(place, line, said, questions)
            for setting, stated in self.known.contradictions(said).items():
                if (setting, stated) not in self._seen:
                    self._seen.add((setting, stated))
                    self._tell(place(), shown(line), setting, stated, questions)

    def _hint(
        self, place: Callable[[], str], line: str, said: Statement, questions: ViewQuestions
    ) -> None:
        """Add what a line states to a question for a sense, whose example may be another."""
        for setting, stated in (("phase", said.phase), ("positive", said.positive)):
            if stated and questions.asked(setting) and (setting, stated) not in self._seen:
                self._seen.add((setting, stated))
                message = f"{shown(line)} states {stated}; if so, say instrument.{setting}={stated}"
                questions.note(UserError(f"{place()}: {message}"), self.path)

    def _tell(
        self, place: str, line: str, setting: str, stated: str, questions: ViewQuestions
    ) -> None:
        """Ask which is right, or note that a setting wins."""
        if setting not in SETTINGS:
            by = self.by.get(setting, "")
            self.odd.append(f"{place}: {line} states {stated}, but {by}, which wins")
            return
        value = getattr(self.settings, setting)
        if value is not None:
            key = self.settings.key(setting) if setting in OF_VIEW else f"instrument.{setting}"
            self.odd.append(f"{place}: {key}={value.name} wins, although {line} states {stated}")
            return
        by = self.by.get(setting, "it is read otherwise")
        message = f"{line} states {stated}, but {by}; say which with instrument.{setting}"
        questions.note(UserError(f"{place}: {message}"), self.path, setting)
