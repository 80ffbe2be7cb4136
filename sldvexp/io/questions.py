"""Questions that files leave open: collected over all of them, and asked in one refusal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from sldvexp.errors import UserError


class OpenQuestionError(UserError):
    """A question that a setting answers, so that reading goes on to find the others."""


@dataclass
class Question:
    """One question, and who leaves it open.

    Parameters
    ----------
    text : str
        Without the place.
    places : list of str
        Files, perhaps with the data set.
    views : list of str
        Whose files these are, if known.
    setting : str
        Of the instrument, as the text names it; empty if several answer it.
    example : str
        A value of the setting that the text ends with, if it does.
    """

    text: str
    places: list[str] = field(default_factory=list)
    views: list[str] = field(default_factory=list)
    setting: str = ""
    example: str = ""

    def asked(self, text: str) -> str:
        """Word it as `text` with the first place, and how many others there are."""
        more = len(set(self.places)) - 1
        return f"{self.places[0]}{f' and {more} more' if more else ''}: {text}"


class Questions:
    """Questions that files leave open.

    Examples
    --------
    >>> questions = Questions()
    >>> for path in ("a.csv", "b.csv"):
    ...     questions.note(UserError(f"{path}: has no unit; say it with instrument.unit"), path)
    >>> bool(questions), questions.texts()
    (True, ['a.csv and 1 more: has no unit; say it with instrument.unit'])
    """

    def __init__(self) -> None:
        self._open: dict[str, Question] = {}

    def __bool__(self) -> bool:
        """Whether something is open."""
        return bool(self._open)

    def note(self, error: UserError, where: str | Path, setting: str = "") -> Question:
        """Note an error that a setting answers; `where` is the file that its text begins with."""
        place, _, text = str(error).removeprefix(str(where)).partition(": ")
        question = self._open.setdefault(text, Question(text, setting=setting))
        question.places.append(f"{where}{place}")
        return question

    def asked(self, setting: str) -> bool:
        """Tell whether a setting is asked for."""
        return any(question.setting == setting for question in self._open.values())

    @contextmanager
    def noting(self, where: str | Path, setting: str = "") -> Iterator[None]:
        """Note a question that is raised within, unless its setting is asked for."""
        try:
            yield
        except OpenQuestionError as error:
            if not setting or not self.asked(setting):
                self.note(error, where, setting)

    def texts(self) -> list[str]:
        """List the questions, each with the place that it is about."""
        return [question.asked(question.text) for question in self._open.values()]

    def done(self) -> None:
        """Raise one `UserError` if anything is open."""
        texts = self.texts()
        if len(texts) == 1:
            raise UserError(texts[0])
        if texts:
            listed = "; ".join(f"({i}) {text}" for i, text in enumerate(texts, 1))
            raise UserError(f"{len(texts)} questions are open: {listed}")
