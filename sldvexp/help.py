"""What `sldvexp --help` prints: the groups, their choices with one line each, and how to go on."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path

from sldvexp import registry

#: Characters of the line about a choice.
WIDTH = 90

INTRODUCTION = """\
sldvexp finds where a scanning laser Doppler vibrometer stood and what moved, with bounds.

usage: sldvexp [group=choice | key=value ...] [options]

  sldvexp                                          the default experiment
  sldvexp experiment=pose pose.path=mine.reg       one of the experiments, on your data
  sldvexp experiment=pose --cfg job                what would be run
  sldvexp -m experiment=pose laser.mirror_offset=0,0.02    one run for each value
  sldvexp --config-dir lab experiment=mine         with experiments and choices of your own
  sldvexp --hydra-help                             all options
"""

NAMED = """\
compare and check hold plugins by name, for example
  compare: {differences: {plugin: relative}}    further reconstructions of the same data
  check: {repeats: {plugin: pose_repeats}}      what is examined after the estimates"""


def text(folders: list[Path]) -> str:
    """The help page.

    Parameters
    ----------
    folders : list of Path
        Configuration folders, the packaged one and the user's.
    """
    parts = [INTRODUCTION, "Groups and their choices:"]
    for group in ("experiment", *registry.GROUPS):
        lines = list(_choices(group, folders))
        if lines:
            parts.append("\n".join([f"\n{group}", *lines]))
    return "\n".join([*parts, "", NAMED])


def _choices(group: str, folders: list[Path]) -> Iterator[str]:
    """A line for each file of a group, and for each plugin that has none."""
    files = {
        str(path.relative_to(folder / group).with_suffix("")): path
        for folder in folders
        for path in sorted((folder / group).rglob("*.yaml"))
    }
    others = [p for p in registry.names(group) if p not in files and _by_name(group, p)]
    for name in [*files, *others]:
        about = _comment(files[name]) if name in files else _docstring(group, name)
        yield f"  {name:32} {textwrap.shorten(about, WIDTH, placeholder=' ...')}"


def _by_name(group: str, name: str) -> bool:
    """Whether a plugin without a file can be chosen: checks, and those of other packages."""
    return group == "check" or not registry.get(group, name).__module__.startswith("sldvexp.")


def _comment(path: Path) -> str:
    """The first sentence of a file's first comment."""
    words = []
    for line in path.read_text().splitlines():
        if not line.startswith("#"):
            break
        if "@package" not in line:
            words.append(line.lstrip("# ").strip())
    return _sentence(" ".join(words))


def _docstring(group: str, name: str) -> str:
    """The first sentence of a plugin's docstring."""
    return _sentence(" ".join((registry.get(group, name).__doc__ or "").split("\n\n")[0].split()))


def _sentence(words: str) -> str:
    """Up to the first full stop that ends a sentence."""
    end = words.find(". ")
    return (words if end < 0 else words[:end]).rstrip(".")
