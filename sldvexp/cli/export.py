"""`sldvexp export <run> <formats>`: results of runs that exist already, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import cast

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sldvexp import dataset
from sldvexp.config import registry
from sldvexp.config.paths import RUN_FILE
from sldvexp.config.refusals import refusal
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import ConfigError, UserError
from sldvexp.export import Export
from sldvexp.progress import doing
from sldvexp.writing import replacing


def run(words: list[str], config_dir: str | None) -> int:
    """Write a run's results beside it, in every format named, or in none if one is refused.

    Raises
    ------
    UserError
        If there is no such run or format, or one cannot hold what the run has.
    """
    formats = [w for w in words[1:] if "=" not in w]
    settings = [w for w in words[1:] if "=" in w]
    if not formats:
        raise UserError(
            "command line: export takes a run.nc, or the folder of one, and formats, as in "
            f"export outputs/<day>/<time> vtu uff; formats: {', '.join(registry.names('export'))}"
        )
    given = Path(words[0])
    path = given / RUN_FILE if given.is_dir() else given
    exports = [_configured(name, settings) for name in formats]
    unused = [s for s in settings if s.partition(".")[0] not in formats]
    if unused:
        raise UserError(f"command line: {unused[0]} must begin with a format that is exported")
    with dataset.load(path) as tree:
        nodes = {node.path.strip("/"): node for node in tree.subtree}
        asked = tuple(group for export in exports for group in export.groups)
        groups = {
            name: node.to_dataset(inherit=False).load()
            for name, node in nodes.items()
            if name in asked or name.startswith(tuple(g for g in asked if g.endswith("/")))
        }
        found = RunData(groups, dict(tree.attrs), path.parent)
    with replacing(path.parent) as made:
        files: list[Path] = []
        for name, export in zip(formats, exports, strict=True):
            with doing(f"format {len(files) + 1} of {len(formats)}: {name}"):
                files.append(export.export(found, made, export.usual_name))
    for file in files:
        print(path.parent / file.relative_to(made))
    return 0


def _configured(name: str, settings: list[str]) -> Export:
    """Make the format with the settings that begin with its name, as in ``vtu.phases=36``."""
    own = [s.removeprefix(f"{name}.") for s in settings if s.startswith(f"{name}.")]
    schema = registry.schema_of(registry.get("export", name))
    try:
        settings_of_it = OmegaConf.merge(schema, OmegaConf.from_dotlist(own))
        return cast(Export, OmegaConf.to_object(settings_of_it))
    except OmegaConfBaseException as error:
        raise UserError(f"command line: {name}.{error.full_key} {refusal(error)}") from None
    except ConfigError as error:
        problem = error.problems[0]
        where = f"{name}.{problem.field}" if problem.field else name
        raise UserError(f"command line: {where} {problem.message}") from None
