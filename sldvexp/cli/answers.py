"""Answers that were given before: pages of help and composed configurations, as they were printed.

They are kept in the user's cache by the question, the state of the program and what else decides
them: for a page of help how wide the terminal is, and what is installed where Python looks for
packages. A question is kept only if nothing else can decide its answer: no folder, package or
setting of others.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress

from sldvexp.config.kept import KeptFiles, name_of

#: Options of a question.
HELP, CONFIGURATION = ("-h", "--help"), ("-c", "--cfg")
HELP_ALONE = tuple([name] for name in HELP)
#: Beginnings of settings that say where configurations are looked for, or how Hydra works.
OF_HYDRA = ("hydra", "resume")


def question(arguments: Sequence[str]) -> str:
    """Name a question; empty if its answer is not kept.

    Examples
    --------
    >>> question(["experiment=point"])
    ''
    >>> bool(question(["experiment=point", "--cfg", "job"]))
    True
    """
    options = [a for a in arguments if a.startswith("-")]
    settings = [a for a in arguments if not a.startswith("-")]
    asked = with_width = options in HELP_ALONE
    if options in ([name] for name in CONFIGURATION):
        asked = "job" in settings and arguments[arguments.index("job") - 1] == options[0]
    others = any("${" in s or s.lstrip("+~").startswith(OF_HYDRA) for s in settings)
    if not asked or others:
        return ""
    places = []
    for place in sys.path:
        with suppress(OSError):
            places.append((place, os.stat(place or ".").st_mtime_ns))
    columns = shutil.get_terminal_size((0, 0)).columns if with_width else None
    return name_of(*arguments, columns, os.environ.get("HYDRA_FULL_ERROR"), places)


def answer(name: str) -> str | None:
    """Find the answer to a question, if it was given before."""
    content = KeptFiles().read(name) if name else None
    return None if content is None else content.decode()


def keep(name: str, text: str) -> None:
    """Keep the answer to a question."""
    KeptFiles().write(name, text.encode())


def tell(text: str) -> None:
    """Print an answer; whoever reads it, as head does, may have seen enough."""
    try:
        print(text, end="", flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def keeping(names: Sequence[str]) -> Iterator[Callable[[bool], None]]:
    """Keep what is printed while in it as the answer to questions, if in the end it is said so."""
    said, surely = io.StringIO(), [False]
    try:
        with redirect_stdout(said):
            yield surely.append
    finally:
        tell(said.getvalue())
    for name in names if surely[-1] else ():
        keep(name, said.getvalue())
