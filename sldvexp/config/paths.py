"""Configuration files: where they lie, what they are called, and what they choose as text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from sldvexp.errors import UserError
from sldvexp.files import read_bytes
from sldvexp.limits import YAML_BYTES, TooMuchError, load_yaml, require_bounded_yaml

CONF_SCHEME = "conf://"

#: The dataset that a run leaves in its folder, once it is done.
RUN_FILE = "run.nc"

#: Folder of a run in which finished scan lines are kept, one folder a view.
JOURNAL = "journal"

#: Digest of all that decides what is measured, in the folder of the lines.
CONFIGURATION = "configuration.sha256"

#: An ending that Hydra does not take.
OTHER_ENDING = ".yml"

#: The pages of the handbook, one file a topic.
HANDBOOK = Path(__file__).resolve().parents[1] / "handbook"

DEFAULTS = "its defaults must be a list of names, as in '- override /pose: registration'"


def conf_dir() -> Path:
    """Find the packaged configuration, or the checkout's when running from one."""
    package = Path(__file__).resolve().parents[1]
    candidates = (package / "conf", package.parent / "conf")
    for candidate in candidates:
        if (candidate / "config.yaml").is_file():
            return candidate
    raise UserError(f"the configuration is missing: neither {candidates[0]} nor {candidates[1]}")


def locate(path: str) -> Path:
    """Find the file that a configuration names: ``conf://`` is the packaged configuration's folder.

    Anything else is relative to the folder where the command was started.
    """
    if path.startswith(CONF_SCHEME):
        return conf_dir() / path.removeprefix(CONF_SCHEME)
    return Path(path).expanduser()


def displayed(file: Path) -> str:
    """Show a configuration file's name for messages."""
    if file.is_relative_to(conf_dir()):
        return f"conf/{file.relative_to(conf_dir())}"
    return str(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file)


def wrong(file: Path) -> str:
    """Say what makes a file no configuration, empty if nothing does."""
    try:
        return _wrong(_read(file))
    except (UnicodeDecodeError, yaml.reader.ReaderError):
        return "is not a text file"
    except UserError as error:
        return str(error).removeprefix(f"{file}: ")
    except yaml.YAMLError:
        return ""


def require_bounded(file: Path) -> None:
    """Complain about a configuration file of others that stands for more than one can.

    Raises
    ------
    UserError
        If it is a device, too long, too deep, or refers to too much.
    """
    if file.resolve().is_relative_to(conf_dir()):
        return
    try:
        require_bounded_yaml(read_bytes(file, YAML_BYTES).decode("utf-8"))
    except TooMuchError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise UserError(f"{displayed(file)}{line}: {error.problem}") from None
    except (UnicodeDecodeError, yaml.YAMLError):
        return  # which is told in other words


def choices(file: Path) -> dict[str, list[str]]:
    """List what a file's defaults list chooses, by group; a bare name is of the file's group."""
    found: dict[str, list[str]] = {}
    for key, chosen in items(file):
        found.setdefault(key.split()[-1].lstrip("/").partition("@")[0], []).extend(chosen)
    return found


def items(file: Path) -> list[tuple[str, list[str]]]:
    """List a file's defaults as they are written, ``override /pose``, each with what it chooses."""
    try:
        content = _read(file)
    except (UserError, UnicodeDecodeError, yaml.YAMLError):
        return []
    if _wrong(content):
        return []
    found = []
    for item in (content or {}).get("defaults", []):
        pairs = item.items() if isinstance(item, dict) else [(file.parent.name, item)]
        found += [(key, [v.partition("@")[0] for v in names(value)]) for key, value in pairs]
    return found


def names(value: Any) -> list[str]:
    """List the names in a choice, which is one or a list."""
    values = value if isinstance(value, list) else [value]
    return [v for v in values if isinstance(v, str)]


def _read(file: Path) -> Any:
    """Read a file, of which anyone may be the author."""
    return load_yaml(read_bytes(file, YAML_BYTES).decode("utf-8"))


def _wrong(content: Any) -> str:
    if not isinstance(content, dict | None):
        return "must be a table of settings, as in pose: {path: mine.reg}"
    items = (content or {}).get("defaults", [])
    if not isinstance(items, list) or not all(map(_is_choice, items)):
        return DEFAULTS
    return ""


def _is_choice(item: Any) -> bool:
    """Tell whether an item of a defaults list is a name, or a group with what is chosen of it."""
    if not isinstance(item, dict):
        return isinstance(item, str)
    return len(item) == 1 and all(
        isinstance(key, str) and (value is None or isinstance(value, str | list))
        for key, value in item.items()
    )
