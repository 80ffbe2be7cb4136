"""Files of the user's own folder that the program writes: experiments, and choices of a group.

What is planned or aimed becomes ``<folder>/<group>/<name>.yaml``, which ``--config-dir <folder>``
and ``<group>=<name>`` choose as any file that was written by hand. Files that belong together are
written whole or not at all, and none in the place of another one unless that is said.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import yaml

from sldvexp.errors import UserError
from sldvexp.writing import make_folder, require_no_link, whole_or_nothing

#: Names that are both a file's and a choice on the command line.
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
#: Columns after which a long list goes on in the next line.
WIDTH = 100


def wrong_name(name: str) -> str:
    """Say why a name cannot be that of a file and of a choice, empty if it can.

    Examples
    --------
    >>> wrong_name("monday_2"), wrong_name("../monday")
    ('', 'cannot be a name; take letters, digits, - and _')
    """
    return "" if NAME.fullmatch(name) else "cannot be a name; take letters, digits, - and _"


def own_path(folder: Path, group: str, name: str) -> Path:
    """Say where a choice of a group lies in the user's folder.

    Examples
    --------
    >>> own_path(Path("lab"), "experiment", "monday").as_posix()
    'lab/experiment/monday.yaml'
    """
    return folder / group / f"{name}.yaml"


def choice_text(
    told: Sequence[str], defaults: Sequence[Any], values: Mapping[str, Any], apart: bool = False
) -> str:
    """Write a choice of a group as YAML.

    Parameters
    ----------
    told : sequence of str
        Comments, a line each.
    defaults : sequence
        Of Hydra: what it is made of.
    values : mapping
        What it sets.
    apart : bool
        Whether it is an experiment, whose keys are those of the whole configuration.

    Examples
    --------
    >>> print(choice_text(["My plate."], ["/experiment/plate", "_self_"], {"seed": 3}, True))
    # @package _global_
    # My plate.
    defaults: [/experiment/plate, _self_]
    <BLANKLINE>
    seed: 3
    <BLANKLINE>
    """
    head = ["# @package _global_"] if apart else []
    parts = [_dumped({"defaults": list(defaults)}), _dumped(dict(values))]
    return "\n".join([*head, *(f"# {line}" for line in told), *parts])


def write_own(texts: Mapping[Path, str], replace: bool, instead: str) -> None:
    """Write files, all of them or none.

    Parameters
    ----------
    texts : mapping of Path to str
    replace : bool
        Whether files that exist are replaced.
    instead : str
        Advice to who has such a file already.

    Raises
    ------
    UserError
        If a file exists and is not to be replaced, or cannot be written.
    """
    require_writable(texts, replace, instead)
    for path in texts:
        make_folder(path.parent)
    with ExitStack() as together:
        beside = [together.enter_context(whole_or_nothing(path)) for path in texts]
        for place, text in zip(beside, texts.values(), strict=True):
            place.write_text(text, encoding="utf-8")


def require_writable(paths: Iterable[Path], replace: bool, instead: str) -> None:
    """Refuse files that exist and are not to be replaced, links and folders; see `write_own`."""
    for path in paths:
        require_no_link(path)
        if path.is_dir():
            raise UserError(f"{path}: cannot be written: it is a folder")
        if path.exists() and not replace:
            raise UserError(f"{path}: exists; {instead}")
        _require_room(path)


def _require_room(path: Path) -> None:
    """Refuse a file in a folder that takes none; files without a name are tried, and leave none."""
    above = next(folder for folder in path.absolute().parents if folder.exists())
    try:
        with TemporaryFile(dir=above):
            pass
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {above}: {error.strerror}") from None


class _Plain(yaml.SafeDumper):
    """Writes lists on one line, and tables over several."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write everything out."""
        return True


def _list(dumper: yaml.SafeDumper, values: list[Any]) -> yaml.Node:
    """Write a list on one line unless it has tables."""
    flow = not any(isinstance(v, dict) for v in values)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=flow)


_Plain.add_representer(list, _list)


def _dumped(values: Any) -> str:
    return yaml.dump(values, Dumper=_Plain, sort_keys=False, width=WIDTH)
