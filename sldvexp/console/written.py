"""Writes what was aimed as an experiment of the user's folder, which a run takes as it is."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sldvexp.config.own_files import choice_text, own_path, write_own, wrong_name
from sldvexp.errors import UserError

#: Choice of an experiment on the command line.
CHOICE = re.compile(r"\+?experiment=(.+)")
#: What the file says of itself.
TOLD = "Aimed with sldvexp console. DAC steps are (up_down, left_right)."


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
    if wrong := wrong_name(name):
        raise UserError(f"{name!r} {wrong}")
    base = [match[1] for text in settings if (match := CHOICE.fullmatch(text))]
    if name in base:
        raise UserError(f"{name}: an experiment cannot be made of itself; take another name")
    defaults = [*(f"/experiment/{b}" for b in base), "_self_"]
    told = [TOLD, f"  {command_with(folder, settings, name)}"]
    path = own_path(folder, "experiment", name)
    text = choice_text(told, defaults, {"scan": scan}, apart=True)
    write_own({path: text}, replace, "take another name, or replace it")
    return path


def command_with(folder: Path, settings: Sequence[str], name: str) -> str:
    """Give the command that scans what was aimed.

    Examples
    --------
    >>> command_with(Path("my lab"), ["experiment=plate"], "aimed")
    "sldvexp --config-dir 'my lab' experiment=aimed"
    """
    words = ["--config-dir", str(folder), *settings_with(settings, name)]
    return f"sldvexp {shlex.join(words)}"


def settings_with(settings: Sequence[str], name: str) -> list[str]:
    """Give settings that choose another experiment, and leave all others as they are.

    Examples
    --------
    >>> settings_with(["experiment=plate", "seed=3"], "aimed")
    ['experiment=aimed', 'seed=3']
    """
    return [f"experiment={name}", *(s for s in settings if not CHOICE.fullmatch(s))]
