"""Page that `sldvexp --help` prints: the groups, their choices, and how to go on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from sldvexp.cli.list import WIDTH, files
from sldvexp.config import docs, registry

INTRODUCTION = """\
sldvexp finds where a scanning laser Doppler vibrometer stood and what moved, with bounds.

usage: sldvexp [group=choice | key=value ...] [options]
       sldvexp [--config-dir lab] command ...

  sldvexp                                          the default experiment
  sldvexp experiment=pose pose.path=mine.reg       one of the experiments, on your data
  sldvexp experiment=pose --cfg job                what would be run
  sldvexp -m experiment=pose laser.mirror_offset=0,0.02    one run for each value
  sldvexp --config-dir lab experiment=mine         with experiments and choices of your own
  sldvexp ~experiment instrument=file ...          from nothing: each choice is yours
  sldvexp resume=<run>                             a session that was cut off, to its end
  sldvexp --hydra-help                             all options

Commands; <run> is the folder of a run, or its run.nc:
  list [group]                 plugins and experiments, one line each
  show pose=edge               what can be set of a choice, and what it means
  handbook [topic]             pages that explain conventions, words, and how a result is read
  check plate lab              whether experiments, or all of a folder, work as they expect
  report <run or sweep>        its page, report.html, anew
  plot <run or sweep> [names]  figures as PNG and SVG
  export <run> vtu uff         its velocities for other programs
  compare <runs or sweeps>     one table and dataset of runs that exist
  rerun <run>                  the run once more; what is not bit-identical, and why
"""

NAMED = """\
compare, check and export hold plugins by name, for example
  compare: {differences: {plugin: relative}}    further reconstructions of the same data
  check: {repeats: {plugin: pose_repeats}}      what is examined after the estimates
  export: {paraview: {plugin: vtu}}             files for other programs, paraview.pvd"""


def text(folders: list[Path]) -> str:
    """Write the help page.

    Parameters
    ----------
    folders : list of Path
        Of configuration files, the first wins.
    """
    parts = [INTRODUCTION, "Groups and their choices:"]
    for group in ("experiment", *registry.GROUPS):
        lines = list(_choices(group, folders))
        if lines:
            parts.append("\n".join([f"\n{group}", *lines]))
    return "\n".join([*parts, "", NAMED])


def _choices(group: str, folders: list[Path]) -> Iterator[str]:
    """Yield a line for each file of a group, and for each plugin that has none."""
    found = files(group, folders)
    others = [p for p in registry.names(group) if p not in found and _by_name(group, p)]
    for name in [*found, *others]:
        file = found.get(name)
        told = docs.of_file(file) if file else docs.of_choice(group, name)
        yield f"  {name:32} {docs.shortened(told, WIDTH)}"


def _by_name(group: str, name: str) -> bool:
    """Tell whether a plugin without a file can be chosen: by name, or of another package."""
    return group in ("check", "export") or name not in registry.BUILT_IN[group]
