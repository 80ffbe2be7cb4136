"""Scan lines and answers, kept one by one, so that a session goes on where it was cut off."""

from __future__ import annotations

import hashlib
import logging
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from sldvexp.config.paths import CONFIGURATION
from sldvexp.errors import UserError
from sldvexp.files import read_bytes
from sldvexp.instrument import Acquisition, RawSamples
from sldvexp.instrument.person import read_answer, write_answer
from sldvexp.instrument.recording import asked, read_left, read_line, write_left, write_line
from sldvexp.signal import ResponseSums
from sldvexp.typing import IntArray
from sldvexp.writing import make_folder, whole_or_nothing

log = logging.getLogger(__name__)

#: Of a file that says which configuration a journal belongs to, at most.
CONFIGURATION_BYTES = 65536
#: What is kept of a scan line: its samples, or the sums of its records.
Measured = RawSamples | ResponseSums


class Journal:
    """Finished scan lines of one view, and what a person found, one small file each.

    Parameters
    ----------
    folder : Path
        Made when the first line is kept.
    lasting : bool
        Whether lines must survive a power cut; a virtual lab gives them again.
    """

    def __init__(self, folder: Path, lasting: bool = True) -> None:
        self.folder, self.lasting = folder, lasting

    def line(
        self,
        name: str,
        dac: IntArray,
        acquisition: Acquisition,
        measure: Callable[[], Measured],
    ) -> Measured:
        """Return the samples of a line, or their sums: kept earlier, or measured now and kept.

        Parameters
        ----------
        name : str
            Of the line, unique in the view.
        dac : ndarray of int, shape (pixel, 2)
        measure : callable
            Called only if the line is not in the journal, or its file is not whole.

        Raises
        ------
        UserError
            If the journal has this line with other pixels or another sampling: it belongs to
            another configuration.
        """
        path = self.folder / f"{name}.npz"
        if path.exists() and (kept := read_line(path)) is not None:
            pixels, how, samples = kept
            if not np.array_equal(pixels, dac) or not np.array_equal(how, asked(acquisition)):
                raise UserError(
                    f"{path}: was measured with other pixels or another sampling; this folder "
                    "belongs to another configuration, start the run in a new one"
                )
            return samples
        return self.replaced(name, dac, acquisition, measure)

    def replaced(
        self,
        name: str,
        dac: IntArray,
        acquisition: Acquisition,
        measure: Callable[[], Measured],
    ) -> Measured:
        """Measure a line and keep it, in the place of what was kept of it, if anything was."""
        samples = measure()
        write_line(self.folder / f"{name}.npz", dac, acquisition, samples, self.lasting)
        return samples

    def has(self, name: str) -> bool:
        """Tell whether there is a line of that name, whole or damaged."""
        return (self.folder / f"{name}.npz").is_file()

    def pixels(self, name: str) -> IntArray | None:
        """Give the pixels of a line that is kept; None if there is none, or it is damaged."""
        path = self.folder / f"{name}.npz"
        kept = read_line(path) if path.exists() else None
        return None if kept is None else kept[0]

    def leave(self, lines: str, done: int) -> None:
        """Keep that the rest of the view is left out, see `sldvexp.instrument.recording`."""
        write_left(self.folder, lines, done)

    @property
    def left(self) -> tuple[str, int] | None:
        """Name and number of the lines after which the rest was left out; None if it was not."""
        return read_left(self.folder)

    def answer(self, name: str, question: Any, ask: Callable[[], Any]) -> Any:
        """Return what a person answered: kept earlier, or asked for now and kept.

        Parameters
        ----------
        name : str
            Of the question, unique in the view.
        question : lists and numbers
            What the answer is about.
        ask : callable
            Called only if the answer is not in the journal, or its file is not whole.

        Returns
        -------
        lists, numbers or None

        Raises
        ------
        UserError
            If the journal has an answer to another question of that name.
        """
        path = self.folder / f"{name}.json"
        if (kept := read_answer(path)) is not None:
            if kept["question"] != question:
                raise UserError(
                    f"{path}: answers another question ({kept['question']}, not {question}); this "
                    "folder belongs to another configuration, start the run in a new one"
                )
            return kept["answer"]
        answer = ask()
        write_answer(path, question, answer)
        return answer

    def take_back(self, name: str) -> None:
        """Take an answer back, so that it is asked for again; its file stays, under another name.

        Parameters
        ----------
        name : str
            Of the question.
        """
        path = self.folder / f"{name}.json"
        if path.exists():
            earlier = len(list(self.folder.glob(f".{name}.*.json")))
            path.replace(self.folder / f".{name}.{earlier + 1}.json")


def adopt_view(folder: Path, source: Path) -> None:
    """Copy what another run has kept of a view, as a whole or not at all.

    Parameters
    ----------
    folder, source : Path
        Of the view, in the one run and the other; `folder` is not there yet.
    """
    beside = folder.with_name(f".{folder.name}")
    shutil.rmtree(beside, ignore_errors=True)
    shutil.copytree(source, beside)
    beside.replace(folder)


def lines_kept(folder: Path) -> dict[str, int]:
    """Count the scan lines that a run's journal has of each view."""
    views = (path for path in folder.glob("[!.]*") if path.is_dir())
    return {view.name: len(list(view.glob("[!.]*.npz"))) for view in sorted(views)}


#: What a line of that file begins with: the digest of a part, or a setting.
KINDS_OF_ORIGIN = "part", "source"
#: Digits of the digest of a part of the configuration.
OF_PART = 16


def digest_of(part: object) -> str:
    """Make the digest of a part of the configuration; its representation is what counts."""
    return hashlib.sha256(repr(part).encode()).hexdigest()[:OF_PART]


@dataclass(frozen=True)
class JournalOrigin:
    """Configuration that a folder of scan lines says it belongs to.

    Attributes
    ----------
    key : str
        Digest of the whole; empty if it is lost.
    parts : dict of str to str
        Digests of its parts by their names, as far as they are told.
    source : dict of str to str
        Settings that say whose lines they are, as far as they are told.
    """

    key: str
    parts: dict[str, str]
    source: dict[str, str]

    @classmethod
    def read(cls, folder: Path) -> JournalOrigin:
        """Read what a folder says; nothing if that is lost."""
        path = folder / CONFIGURATION
        found = read_bytes(path, CONFIGURATION_BYTES) if path.exists() else b""
        text = found.decode("utf-8", "replace")
        first, *rest = text.splitlines() or [""]
        key = first if re.fullmatch("[0-9a-f]{64}", first) else ""
        told = [line.partition(":")[::2] for line in rest if key]
        pairs = [(kind, *text.partition("=")[::2]) for kind, text in told]
        parts, source = ({n: v for k, n, v in pairs if k == kind} for kind in KINDS_OF_ORIGIN)
        return cls(key, parts, source)

    def write(self, folder: Path) -> None:
        """Say so in a folder."""
        both = zip(KINDS_OF_ORIGIN, (self.parts, self.source), strict=True)
        lines = [f"{kind}:{name}={value}" for kind, of in both for name, value in of.items()]
        make_folder(folder)
        with whole_or_nothing(folder / CONFIGURATION) as beside:
            beside.write_text("\n".join([self.key, *lines]), encoding="utf-8")


def require_same(
    folder: Path, parts: Mapping[str, object], source: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Tie a folder of scan lines to the configuration that they are measured with.

    A digest that is missing or damaged says nothing of the lines; each of them knows its pixels and
    its sampling.

    Parameters
    ----------
    folder : Path
        Of all views.
    parts : dict of str to object
        Everything that decides what is measured; its representation is what counts.
    source : dict of str to str
        Settings of the instrument that say whose lines they are, with their values.

    Raises
    ------
    UserError
        If the folder has lines of another configuration, or of another source.
    """
    key = hashlib.sha256(repr(tuple(parts.values())).encode()).hexdigest()
    digests = {name: digest_of(part) for name, part in parts.items()}
    now, kept = JournalOrigin(key, digests, dict(source)), JournalOrigin.read(folder)
    if kept.key not in ("", key):
        differ = [name for name in digests if kept.parts.get(name, "") != digests[name]]
        told = f"{' and '.join(differ)} differ{'s' * (len(differ) == 1)}"
        if not kept.parts:
            told = f"{', '.join([*digests][:-1])} or {[*digests][-1]} differ"
        raise UserError(
            f"{folder}: has scan lines of another configuration ({told}); start the run in a new "
            "folder"
        )
    for name, value in source.items():
        if kept.source.get(name, value) != value:
            raise UserError(
                f"{folder}: has scan lines of {name}={kept.source[name]}, and lines of "
                f"{name}={value} would be mixed with them; go on with "
                f"{name}={kept.source[name]}, or start the run in a new folder"
            )
    if not kept.key and any(file.suffix in (".npz", ".json") for file in folder.rglob("[!.]*")):
        log.warning(
            "%s: does not say any more which configuration its scan lines belong to; those are "
            "used that have the pixels and the sampling of this one",
            folder,
        )
    if kept != now:
        now.write(folder)
