"""Writes what was aimed as an experiment of the user's folder, which a run takes as it is."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from sldvexp.errors import UserError
from sldvexp.writing import make_folder, whole_or_nothing

#: Choice of an experiment on the command line.
CHOICE = re.compile(r"\+?experiment=(.+)")
#: Names that are both a file's and a choice on the command line.
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")

HEAD = """# @package _global_
# Aimed with sldvexp console. DAC steps are (up_down, left_right).
#   sldvexp --config-dir {folder} {settings}
"""


def write_experiment(
    folder: Path,
    name: str,
    settings: Sequence[str],
    scan: dict[str, Any],
    replace: bool = False,
) -> Path:
    """Write an experiment that is another one with these places of its scan.

    Parameters
    ----------
    folder : Path
        Of the user, as ``--config-dir`` names it.
    name : str
        Of the new experiment.
    settings : sequence of str
        With which the console was started.
    scan : dict
        As `AimedMarks.settings` makes it.
    replace : bool
        Whether a file of that name may be replaced.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    UserError
        If the name cannot be one, or there is such a file already.
    """
    if not NAME.fullmatch(name):
        raise UserError(f"{name!r} cannot be the name of an experiment; take letters and digits")
    path = folder / "experiment" / f"{name}.yaml"
    if path.exists() and not replace:
        raise UserError(f"{path}: is there already; take another name, or replace it")
    base = [match[1] for text in settings if (match := CHOICE.fullmatch(text))]
    if name in base:
        raise UserError(f"{name}: an experiment cannot be made of itself; take another name")
    content: dict[str, Any] = {"defaults": [*(f"/experiment/{b}" for b in base), "_self_"]}
    content["scan"] = scan
    text = yaml.dump(content, default_flow_style=None, sort_keys=False, width=100)
    make_folder(path.parent)
    line = shlex.join(settings_with(settings, name))
    with whole_or_nothing(path) as beside:
        beside.write_text(HEAD.format(folder=shlex.quote(str(folder)), settings=line) + text)
    return path


def settings_with(settings: Sequence[str], name: str) -> list[str]:
    """Give settings that choose another experiment, and leave all others as they are.

    Examples
    --------
    >>> settings_with(["experiment=plate", "seed=3"], "aimed")
    ['experiment=aimed', 'seed=3']
    """
    return [f"experiment={name}", *(s for s in settings if not CHOICE.fullmatch(s))]
