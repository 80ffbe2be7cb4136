"""Configuration files: where they lie, what they are called, and what they choose as text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from sldvexp.errors import UserError

CONF_SCHEME = "conf://"

#: The dataset that a run leaves in its folder, once it is done.
RUN_FILE = "run.nc"

#: Folder of a run in which finished scan lines are kept, one folder a view.
JOURNAL = "journal"

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
    except (OSError, yaml.YAMLError):
        return ""


def choices(file: Path) -> dict[str, list[str]]:
    """List what a file's defaults list chooses, by group; a bare name is of the file's group."""
    try:
        content = _read(file)
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return {}
    if _wrong(content):
        return {}
    found: dict[str, list[str]] = {}
    for item in (content or {}).get("defaults", []):
        pairs = item.items() if isinstance(item, dict) else [(file.parent.name, item)]
        for key, value in pairs:
            group = key.split()[-1].lstrip("/").partition("@")[0]
            found.setdefault(group, []).extend(v.partition("@")[0] for v in names(value))
    return found


def names(value: Any) -> list[str]:
    """List the names in a choice, which is one or a list."""
    values = value if isinstance(value, list) else [value]
    return [v for v in values if isinstance(v, str)]


def _read(file: Path) -> Any:
    """Read a file; the loader that is compiled is ten times faster, where there is one."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return yaml.load(file.read_text(encoding="utf-8"), loader)


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
