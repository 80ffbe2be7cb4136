"""Scan lines in a folder: how a session keeps them, and how they are played again.

`instrument=replay`: a recorded session in the place of an instrument.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray
from omegaconf import MISSING

from sldvexp.config.paths import JOURNAL, locate
from sldvexp.config.registry import register
from sldvexp.errors import UserError, nearest
from sldvexp.files import require_file
from sldvexp.instrument.person import RecordedPerson, read_answer, write_answer
from sldvexp.instrument.protocol import (
    CHANNELS,
    Acquisition,
    Instrument,
    InstrumentError,
    RawSamples,
    ScanningPlugin,
)
from sldvexp.io.arrays import read_arrays, write_arrays
from sldvexp.laser import TwoMirror
from sldvexp.limits import too_much_claimed
from sldvexp.signal import ExcitationKind, LineChoice, ResponseSums
from sldvexp.targets import Target
from sldvexp.typing import Array, IntArray
from sldvexp.writing import make_folder, whole_file

#: Arrays of a kept line, and the kinds of numbers that each may have.
KINDS = {"dac": "iu", "asked": "f", "counts": "iu", "volts_per_count": "f", "status": "iu"}
#: Lines of so many bytes or fewer are read as a whole, whatever is wanted of them.
AT_ONCE = 2**20
#: What reading a damaged line raises.
DAMAGED = (
    zipfile.BadZipFile,
    ValueError,
    TypeError,
    EOFError,
    KeyError,
    MemoryError,
    OSError,
)


def write_line(
    path: Path,
    dac: IntArray,
    acquisition: Acquisition,
    samples: RawSamples | ResponseSums,
    lasting: bool = True,
) -> None:
    """Keep a scan line, whole or not at all.

    Parameters
    ----------
    dac : ndarray of int, shape (pixel, 2)
    acquisition : Acquisition
        What was asked for.
    samples : RawSamples or ResponseSums
        What came, or the sums of its records.
    lasting : bool
        See `sldvexp.writing.whole_or_nothing`.
    """
    found: dict[str, Any]
    if isinstance(samples, ResponseSums):
        found = samples.to_arrays()
    else:
        found = {
            "counts": samples.counts,
            "volts_per_count": samples.volts_per_count,
            "rate": np.array(samples.rate),
            "status": samples.status,
        }
    make_folder(path.parent)
    with whole_file(path, lasting) as file:
        write_arrays(file, dac=np.asarray(dac), asked=asked(acquisition), **found)


def read_line(path: Path) -> tuple[IntArray, Array, RawSamples | ResponseSums] | None:
    """Read pixels, sampling as asked, and samples or sums of a kept line; None if it is damaged.

    An array may claim no more than a file of that size can hold, and its shape must go with those
    of the others.
    """
    try:
        with _opened(path) as kept:
            if "sxy" in kept:
                return _sums(kept)
            found = {key: kept[key] for key in (*KINDS, "rate")}
        pixels = len(found["dac"])
        shapes = {"dac": (pixels, 2), "volts_per_count": (len(CHANNELS),), "status": (pixels,)}
        shapes |= {"counts": (pixels, len(CHANNELS), *found["counts"].shape[2:3])}
        sound = all(found[key].dtype.kind in kinds for key, kinds in KINDS.items())
        if not len(found["status"]):  # of an instrument that tells none
            shapes["status"] = (0,)
        if not sound or any(found[key].shape != shape for key, shape in shapes.items()):
            return None
        samples = RawSamples(
            found["counts"], found["volts_per_count"], float(found["rate"]), found["status"]
        )
        return found["dac"], found["asked"], samples
    except DAMAGED:
        return None


def read_pixels(path: Path) -> tuple[IntArray, Array] | None:
    """Read pixels and sampling as asked of a kept line, and no more; None if it is damaged."""
    try:
        with _opened(path) as kept:
            dac, how = kept["dac"], kept["asked"]
    except DAMAGED:
        return None
    sound = dac.dtype.kind in KINDS["dac"] and dac.shape[1:] == (2,)
    return (dac, how) if sound else None


@contextmanager
def _opened(path: Path) -> Iterator[Mapping[str, NDArray[Any]]]:
    """Open a kept line whose arrays claim no more than a file of that size can hold."""
    require_file(path)
    size = path.stat().st_size
    if size <= AT_ONCE and (found := read_arrays(path.read_bytes())) is not None:
        yield found
        return
    with np.load(path) as kept:
        if not isinstance(kept, NpzFile):
            raise ValueError("not a line")
        assert kept.zip is not None  # until it is closed
        if too_much_claimed(sum(part.file_size for part in kept.zip.infolist()), size):
            raise ValueError("claims more than it holds")
        yield kept


def _sums(kept: Mapping[str, NDArray[Any]]) -> tuple[IntArray, Array, ResponseSums] | None:
    """Make sums of records of a kept line; None if they do not belong to its pixels."""
    dac, how, sums = kept["dac"], kept["asked"], ResponseSums.from_arrays(kept)
    shape = (len(dac), len(sums.frequency))
    sound = all(each.shape == shape for each in (sums.sxx, sums.syy, sums.sxy))
    if not sound or dac.shape != (len(dac), 2) or sums.count.shape != (len(dac),):
        return None
    return dac, how, sums


def line_name(name: str, place: int) -> str:
    """Name a line in the journal by that of its lines and its place among them, from 0."""
    return f"{name}_{place:03d}"


def asked(acquisition: Acquisition) -> Array:
    """Express an acquisition as numbers that can be kept and compared."""
    a = acquisition
    if a.drive is None:
        return np.array([a.rate, a.samples, a.amplitude, *a.excitation], float)
    e = a.drive.excitation
    # A negative number, which no frequency is, begins what is played instead of tones.
    kind, lines = (list(type(x)).index(x) for x in (e.kind, e.lines))
    played = [-1.0, kind, lines, *e.band, e.seed, e.burst, e.decay]
    how = [a.records, a.lead, a.triggered]
    return np.array([a.rate, a.samples, a.amplitude, *played, *how], float)


def _settings(how: Array) -> dict[str, object]:
    """Name what `asked` gave by the settings of a scan's sampling."""
    numbers = how.tolist()
    named = dict(zip(("rate", "samples", "amplitude"), numbers, strict=False))
    played = numbers[len(named) :]
    if played[:1] != [-1.0]:
        return named | {"excitation": ExcitationKind.sine.name, "frequency": played}
    kinds, lines = (dict(enumerate(e.name for e in of)) for of in (ExcitationKind, LineChoice))
    keys = ("excitation", "lines", "low", "high", "seed", "burst", "decay", "records", "lead")
    told = dict(zip((*keys, "trigger"), played[1:], strict=False))
    told |= {"band": [told.pop(end, None) for end in ("low", "high")]}
    for key, of in (("excitation", kinds), ("lines", lines)):
        told[key] = of.get(told.get(key, -1), "unknown")
    return named | told | {"trigger": "generator" if told.get("trigger") else "free"}


def unlike(kept: Array, wanted: Array) -> tuple[str, str]:
    """Write the settings in which two samplings differ, with the values of either.

    Parameters
    ----------
    kept, wanted : ndarray
        As `asked` gives them.

    Examples
    --------
    >>> unlike(np.array([1000, 64, 1.0, 50]), np.array([1000, 64, 2.0, 50]))
    ('sampling.amplitude=1', 'sampling.amplitude=2')
    """
    both = _settings(kept), _settings(wanted)
    keys = [k for k in dict.fromkeys([*both[0], *both[1]]) if both[0].get(k) != both[1].get(k)]
    if both[0].get("excitation") != both[1].get("excitation"):
        keys = ["excitation"]
    told = [[f"sampling.{k}={_short(of[k])}" for k in keys if k in of] for of in both]
    first, second = (" and ".join(each) for each in told)
    return first, second


def _short(value: object) -> str:
    """Write a setting's value as on a command line."""
    if isinstance(value, list):
        return f"[{','.join(map(_short, value))}]"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


#: Name of what is kept of a view whose rest was left out.
LEFT = "left"


def write_left(folder: Path, lines: str, done: int) -> None:
    """Keep, in a view's folder, that the rest of the view is left out.

    Parameters
    ----------
    lines : str
        Name of the lines that were scanned together last.
    done : int
        How many of them are kept.
    """
    write_answer(folder / f"{LEFT}.json", lines, done)


def read_left(folder: Path) -> tuple[str, int] | None:
    """Read name and number of the lines after which a view was left; None if it was not."""
    kept = read_answer(folder / f"{LEFT}.json")
    return None if kept is None else (str(kept["question"]), int(kept["answer"]))


@runtime_checkable
class TellsSums(Protocol):
    """An instrument that has the sums of records instead of the records themselves.

    Attributes
    ----------
    folder : Path
        Where it has them.
    """

    folder: Path

    def sums(self, dac: IntArray) -> ResponseSums:
        """Give the sums of a line of these very pixels."""


class Recording:
    """A recorded view as an `Instrument`: it can scan what was scanned, and nothing else.

    In memory it has where each line is kept, by its pixels; samples stay on disk until they are
    asked for.

    Parameters
    ----------
    folder : Path
        Of the run.
    view : str
    """

    def __init__(self, folder: Path, view: str) -> None:
        views = sorted(p.name for p in (folder / JOURNAL).glob("*") if p.is_dir())
        if view not in views:
            told = nearest(view, views) if views else "it has no scan lines at all"
            raise UserError(f"{folder}: has no scan lines of the view {view}; {told}")
        self.folder, self.view = folder, view
        self._lines: dict[bytes, list[tuple[Array, Path]]] = {}
        samplings: dict[bytes, Array] = {}  # most lines have the same
        for path in sorted((folder / JOURNAL / view).glob("*.npz")):
            if (kept := read_pixels(path)) is not None:
                dac, how = kept
                how = samplings.setdefault(how.tobytes(), how)
                self._lines.setdefault(self._key(dac), []).append((how, path))
        self._asked = np.zeros(0)
        self._dac = np.zeros((1, 2), np.int64)

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *exception: object) -> None:
        return None

    @property
    def person(self) -> RecordedPerson:
        """Who pointed and digitised then."""
        return RecordedPerson(self.folder / JOURNAL / self.view)

    def configure(self, acquisition: Acquisition) -> None:
        """Take note of the sampling, which must be that of the recording."""
        self._asked = asked(acquisition)

    def move(self, dac: Sequence[int]) -> None:
        """Choose the pixel that `acquire` gives."""
        self._dac = np.array([dac], np.int64)

    def acquire(self) -> RawSamples:
        """Return the recorded pixel, if a line of one pixel there was recorded."""
        return self.scan(self._dac)

    def scan(self, dac: IntArray, stream: int | None = None) -> RawSamples:
        """Return the samples of a line with these very pixels and sampling.

        If it was recorded several times, each of them in turn.

        Raises
        ------
        InstrumentError
            If there is none.
        """
        found = self._found(dac)
        assert isinstance(found, RawSamples)  # as the sampling says, which is the recording's
        return found

    def sums(self, dac: IntArray) -> ResponseSums:
        """See `TellsSums`; raises what `scan` does."""
        found = self._found(dac)
        assert isinstance(found, ResponseSums)
        return found

    def _found(self, dac: IntArray) -> RawSamples | ResponseSums:
        """Find what was kept of a line, the next in turn."""
        found = self._lines.get(self._key(dac), [])
        while found:
            fits = [i for i, (how, _) in enumerate(found) if np.array_equal(how, self._asked)]
            if not fits:
                recorded, wanted = unlike(found[0][0], self._asked)
                raise InstrumentError(
                    f"{self.folder}: was sampled with {recorded}, not with {wanted}; the scan's "
                    "sampling must say the same, or scan anew"
                )
            line = found.pop(fits[0])
            if (whole := read_line(line[1])) is not None:
                found.append(line)
                return whole[2]
        raise InstrumentError(
            f"{self.folder}: the view {self.view} has no scan line of {len(dac)} pixels from "
            f"({dac[0, 0]}, {dac[0, 1]}) to ({dac[-1, 0]}, {dac[-1, 1]}); a recording can only "
            "be scanned as it was"
        )

    @staticmethod
    def _key(dac: IntArray) -> bytes:
        return hashlib.blake2b(dac.astype(np.int64).tobytes(), digest_size=16).digest()


@register("instrument", "replay")
@dataclass
class Replay(ScanningPlugin):
    """Scan lines that an earlier run kept, so that they can be processed anew.

    Parameters
    ----------
    path : str
        Folder of that run.
    """

    real = False
    path: str = MISSING

    @property
    def source(self) -> dict[str, str]:
        """See `ScanningPlugin`; the run, from wherever it is named."""
        return {"path": str(locate(self.path).resolve())}

    def left(self, view: str) -> tuple[str, int] | None:
        """See `ScanningPlugin`."""
        return read_left(locate(self.path) / JOURNAL / view)

    def recorded(self, view: str, name: str) -> list[IntArray]:
        """See `ScanningPlugin`; those before the first that is missing or damaged."""
        folder = locate(self.path) / JOURNAL / view
        found: list[IntArray] = []
        while (path := folder / f"{line_name(name, len(found))}.npz").is_file():
            if (kept := read_pixels(path)) is None:
                break
            found.append(kept[0])
        return found

    def open(
        self,
        scene: Any,
        laser: TwoMirror,
        target: Target | None = None,
        seed: int = 0,
        view: str = "",
    ) -> AbstractContextManager[Instrument]:
        """See `ScanningPlugin`.

        Raises
        ------
        UserError
            If the run has no scan lines of that view.
        """
        return Recording(locate(self.path), view)
