"""Where the packaged configuration lies, and which file a configuration means."""

from __future__ import annotations

from pathlib import Path

from sldvexp.errors import UserError

CONF_SCHEME = "conf://"

#: The dataset that a run leaves in its folder, once it is done.
RUN_FILE = "run.nc"

#: The pages of the handbook, one file a topic.
HANDBOOK = Path(__file__).resolve().parents[1] / "handbook"


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
