"""What can be chosen, in its own words: a file's comment, a plugin's docstring."""

from __future__ import annotations

import inspect
import re
from pathlib import Path


def of_file(file: Path) -> str:
    """The first sentence of a configuration file's first comment."""
    return sentence(" ".join(comment(file)))


def of_plugin(plugin: type) -> str:
    """The first sentence of a plugin's docstring."""
    return sentence(next(iter(description(plugin)), ""))


def description(plugin: type) -> list[str]:
    """The paragraphs of a plugin's docstring, up to its sections."""
    told = inspect.cleandoc(plugin.__dict__.get("__doc__") or "")
    if told.startswith(f"{plugin.__name__}("):
        return []  # a dataclass without a docstring gets its signature
    told = re.split(r"^\w.*\n-+$", told, maxsplit=1, flags=re.MULTILINE)[0]
    return [" ".join(part.split()).replace("`", "") for part in told.split("\n\n") if part.strip()]


def comment(file: Path) -> list[str]:
    """The lines of the comment that a configuration file begins with, but for Hydra's."""
    lines = []
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        if not line.startswith("#"):
            break
        if "@package" not in line:
            lines.append(line.lstrip("# ").rstrip())
    return lines


def shortened(line: str, width: int) -> str:
    """A line that is not longer than so many characters."""
    return line if len(line) <= width else f"{line[: width - 4].rpartition(' ')[0]} ..."


def sentence(words: str) -> str:
    """Up to the first full stop that ends a sentence."""
    end = words.find(". ")
    return (words if end < 0 else words[:end]).rstrip(".")
