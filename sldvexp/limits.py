"""How much a file may ask for: bytes, lines, depth, and what its text stands for.

Anyone may have written a file, and a short one can stand for more than a machine has: nested
references of YAML double with every line, and an array claims any size in a few bytes. Every limit
is far above what measurements need, and a refusal at it costs less than 500 MB and 5 s.
"""

from __future__ import annotations

import os
import re
import select
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

#: Of a table of text or another file that is read as a whole.
TEXT_BYTES, TEXT_LINES = 128 * 2**20, 1_500_000
#: Of one line of it: hundred thousand columns.
LINE_BYTES = 2 * 2**20
#: Of a configuration.
YAML_BYTES = 2**20
YAML_DEPTH = 60
#: Characters of a text that a slow parser may look at too.
WORDED = 100_000
YAML_REFERENCES = 30
#: Values in a configuration, those that are referred to counted each time.
YAML_VALUES = 20_000
#: Bytes that the arrays of a file may claim, and how many for each byte of it beyond: deflated
#: measurements shrink two to ten times.
CLAIMED_BYTES, CLAIMED_RATIO = 64 * 2**20, 50
#: Groups of a file, one in the other, and all together.
GROUP_DEPTH, GROUPS = 30, 5_000
#: Bytes of memory and s of processor time that opening a file may take.
OPENING, SECONDS = 256 * 2**20, 4
#: s after which such a process is ended that waits for something.
PATIENCE = 60.0
#: What this process has of memory, in pages.
STATM = Path("/proc/self/statm")
#: Characters of a sentence, and of a name or value in one.
SENTENCE, SHOWN = 2000, 200


class TooMuchError(yaml.MarkedYAMLError):
    """YAML that stands for more than a configuration can be, or says a thing twice."""


def require_bounded_yaml(text: str) -> None:
    """Complain about YAML that is too long or too deep, or that refers to too much or to itself.

    Events of the parser are counted before anything is made of them; a reference counts as much as
    what it refers to. A key that is twice in a table is refused too: readers of YAML keep the last
    in silence.

    Raises
    ------
    TooMuchError
    yaml.YAMLError
        If it is none.

    Examples
    --------
    >>> require_bounded_yaml("{a: &a [1, 2], b: [*a, *a]}")
    >>> require_bounded_yaml("[" * 100)
    Traceback (most recent call last):
    sldvexp.limits.TooMuchError: has tables or lists more than 60 deep in each other
      in "<unicode string>", line 1, column 61
    """
    if len(text) > YAML_BYTES:
        raise TooMuchError(problem=f"has more than {YAML_BYTES >> 20} MB of text")
    try:
        _count(yaml.parse(text, _PlainLoader))
    except yaml.scanner.ScannerError as error:
        if "nesting depth" not in str(error.problem):  # libyaml has a limit of its own
            raise
        told = f"has tables or lists more than {YAML_DEPTH} deep in each other"
        raise TooMuchError(problem=told, problem_mark=error.problem_mark) from None


def _count(events: Iterator[yaml.Event]) -> None:
    """Count values and depth of the events of a text, and complain where they are too many."""
    sizes: dict[str, int] = {}
    begun: list[tuple[str | None, int]] = []
    keys = _Keys()
    values = 0
    for event in events:
        told = keys.repeated(event)
        if isinstance(event, yaml.AliasEvent):
            open_ = any(anchor == event.anchor for anchor, _ in begun)
            told = f"{event.anchor} refers to itself" if open_ else told
            values += sizes.get(event.anchor, 1)
        elif isinstance(event, yaml.CollectionStartEvent):
            begun.append((event.anchor, values))
            if len(begun) > YAML_DEPTH:
                told = f"has tables or lists more than {YAML_DEPTH} deep in each other"
            values += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = begun.pop()
            if anchor:
                sizes[anchor] = values - before
        elif isinstance(event, yaml.ScalarEvent):
            values += 1
            if event.value.count("${") > YAML_REFERENCES:
                told = f"has a text with more than {YAML_REFERENCES} references"
        if values > YAML_VALUES:
            told = f"has more than {YAML_VALUES} values, with those that it refers to"
        if told:
            raise TooMuchError(problem=told, problem_mark=event.start_mark)


class _Keys:
    """Keys of the tables that are open while the events of a text go by.

    Each open table has its keys with their lines, and the pair that is being read; a list has None.
    """

    def __init__(self) -> None:
        self._open: list[tuple[dict[str, int], list[str]] | None] = []

    def repeated(self, event: yaml.Event) -> str:
        """Take an event, and say which key it repeats; empty if none."""
        if isinstance(event, yaml.CollectionEndEvent):
            self._open.pop()
            return ""
        told = self._taken(event) if self._open and isinstance(event, yaml.NodeEvent) else ""
        if isinstance(event, yaml.CollectionStartEvent):
            self._open.append(({}, []) if isinstance(event, yaml.MappingStartEvent) else None)
        return told

    def _taken(self, event: yaml.NodeEvent) -> str:
        """Take a key, its value or an item of a list."""
        if (table := self._open[-1]) is None:
            return ""
        lines, pair = table
        if len(pair) == 1:  # a key, of which this is the value
            pair.append("")
            return ""
        key = event.value if isinstance(event, yaml.ScalarEvent) else ""
        pair[:] = [key]
        if key not in lines or key in ("", "<<"):
            lines[key] = event.start_mark.line + 1
            return ""
        above = [pair[0] for _, pair in filter(None, self._open[:-1])]
        name = ".".join([*above, key])
        return f"{name} is there twice, first in line {lines[key]}; one of them needs another name"


class _PlainLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The parser that is compiled, where there is one."""


def load_yaml(text: str, loader: Any = None) -> Any:
    """Read YAML of anyone: plain values only, of a bounded size.

    Parameters
    ----------
    loader : type, optional
        Instead of PyYAML's for plain values.

    Raises
    ------
    yaml.YAMLError
        If it is none, or too much.

    Examples
    --------
    >>> load_yaml("{noise: 1.0e-3, rows: all}")
    {'noise': 0.001, 'rows': 'all'}
    """
    try:
        require_bounded_yaml(text)
        return yaml.load(text, loader or _PlainLoader)
    except TooMuchError:
        raise
    except yaml.YAMLError:
        if len(text) < WORDED:  # the usual parser has the better words
            yaml.load(text, loader or yaml.SafeLoader)
        raise
    except (ValueError, TypeError, OverflowError) as error:  # as of the date 2026-99-99
        raise yaml.YAMLError(f"has a value that cannot be read: {error}") from None


def too_much_text(content: bytes) -> str:
    """Say what makes a text too long to be read; empty if nothing does."""
    if len(content) > TEXT_BYTES:
        return f"has more than {TEXT_BYTES >> 20} MB of text"
    if content.count(b"\n") + content.count(b"\r") > 2 * TEXT_LINES:
        return f"has more than {TEXT_LINES} lines"
    start = 0
    while len(content) - start > LINE_BYTES:
        stop = start + LINE_BYTES + 1
        end = content.rfind(b"\n", start, stop)
        end = end if end >= 0 else content.rfind(b"\r", start, stop)
        if end < 0:
            line = 1 + content.count(b"\n", 0, start)
            return f"has a line of more than {LINE_BYTES >> 20} MB, line {line}"
        start = end + 1
    return ""


def too_many_groups(children: Callable[[Any], Iterator[Any]], root: Any) -> str:
    """Say what makes groups in groups more than a run can have; empty if nothing does.

    Parameters
    ----------
    children : callable
        Yields the groups of a group.
    """
    level, count = [root], 0
    for _ in range(GROUP_DEPTH):
        level = [below for group in level for below in children(group)]
        count += len(level)
        if count > GROUPS:
            return f"has more than {GROUPS} groups"
        if not level:
            return ""
    return f"has groups more than {GROUP_DEPTH} deep in each other"


def slow_pattern(text: str) -> str:
    r"""Say that a regular expression may take for ever; empty if it does not.

    Repetitions in repetitions try as many ways as there are to divide a text.

    Examples
    --------
    >>> slow_pattern(r"(-?\d+),.*"), slow_pattern("(a+)+$")
    ('', 'has a repetition in a repetition, which may take for ever')
    """
    nodes = [(part, False) for part in re._parser.parse(text)]  # type: ignore[attr-defined]
    while nodes:
        (kind, given), repeated = nodes.pop()
        many = "REPEAT" in str(kind) and given[1] > 1 and given[1] != given[0]
        if many and repeated:
            return "has a repetition in a repetition, which may take for ever"
        nodes += [(part, repeated or many) for part in _parts(given)]
    return ""


def _parts(given: Any) -> Iterator[Any]:
    """Yield the parts of a regular expression that a part of it consists of."""
    if isinstance(given, re._parser.SubPattern):  # type: ignore[attr-defined]
        yield from given
    elif isinstance(given, list | tuple):
        for each in given:
            yield from _parts(each)


def tried_apart(look: Callable[[], str]) -> str:
    """Look at something in a process of its own that a library may end; what it says.

    A library written in C follows groups that lie in themselves until all memory is gone, and ends
    the program at damage that it did not foresee. The process is a copy of this one with little
    memory and time; where it cannot be made, this one looks itself.

    Raises
    ------
    ChildProcessError
        If the process was ended, or found something that `look` raised.
    """
    if resource is None or sys.platform != "linux":
        return look()
    read, write = os.pipe()
    with warnings.catch_warnings():
        # It does nothing but look and end, so that no lock of another thread matters.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if not child:
        _look_and_end(look, write)
    os.close(write)
    ready, _, _ = select.select([read], [], [], PATIENCE)
    if not ready:
        os.kill(child, signal.SIGKILL)
    with os.fdopen(read, "rb") as said:
        answer = said.read().decode("utf-8", "replace")
    _, status = os.waitpid(child, 0)
    if status:
        raise ChildProcessError(answer or "it ends the library that reads it")
    return answer


def _look_and_end(look: Callable[[], str], write: int) -> None:
    """Do what the process does that `tried_apart` makes, and end it."""
    status = 1
    try:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 2)  # libraries complain before they end
        pages = int(STATM.read_text().split()[0]) if STATM.is_file() else 0
        if pages:
            most = pages * resource.getpagesize() + OPENING
            resource.setrlimit(resource.RLIMIT_AS, (most, -1))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.write(write, look().encode())
        status = 0
    except BaseException as error:
        os.write(write, " ".join(str(error).split())[:SHOWN].encode("utf-8", "replace"))
    finally:
        os._exit(status)


def too_much_claimed(claimed: int, size: int) -> str:
    """Say that arrays claim more bytes than a file of a size can hold; empty if they do not.

    Examples
    --------
    >>> too_much_claimed(2**20, 1000), too_much_claimed(8 * 10**12, 20_000)
    ('', 'claims arrays of 8000000 MB, and has 0.02 MB')
    """
    if claimed <= CLAIMED_BYTES + CLAIMED_RATIO * size:
        return ""
    return f"claims arrays of {claimed / 1e6:.0f} MB, and has {size / 1e6:.2g} MB"


def shown(text: str, most: int = SENTENCE) -> str:
    r"""Shorten a text for a message, and spell characters that would act on a terminal.

    Examples
    --------
    >>> shown("the mark \x1b[2J"), shown("x" * 50, 20)
    ('the mark \\x1b[2J', 'xxxxxxxxx ... xxxxxx')
    """
    if len(text) > most:
        text = f"{text[: most // 2 - 1]} ... {text[-(most // 2 - 4) :]}"
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)
