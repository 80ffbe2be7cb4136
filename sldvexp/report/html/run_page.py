"""The page of a run: its sections in the order in which one reads them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from sldvexp.dataset import RunData, load
from sldvexp.report.html import diagnostics, modal, render, results, setup
from sldvexp.report.html.blocks import Section

#: Each makes a section of what a run has, or none; another part of the page is a line here. What
#: was found comes first, then what it was found from.
SECTIONS: tuple[Callable[[RunData], Section | None], ...] = (
    results.result_section,
    modal.modes_section,
    modal.model_section,
    diagnostics.findings_section,
    results.pose_section,
    results.images_section,
    results.velocity_section,
    results.strain_section,
    diagnostics.checks_section,
    setup.setup_section,
    diagnostics.provenance_section,
)

#: Values of a variable that is read whole, at most.
FEW = 1 << 18


def write(path: Path, page: Path) -> Path:
    """Make the page of a run from its dataset alone.

    Parameters
    ----------
    path : Path
        ``run.nc``.
    page : Path
        Where to.

    Returns
    -------
    Path
        `page`.

    Raises
    ------
    UserError
        If the file is not a run's.
    """
    with load(path) as tree:
        run = replace(RunData.from_source(tree), path=path)
        _read_few(run)
        return write_of(run, page)


def write_of(run: RunData, page: Path) -> Path:
    """Make the page of a run that is open or in memory, see `write`."""
    _ = run.config, run.plugins  # a file that has none is not a run's, and is refused
    sections = [s for make in SECTIONS if (s := make(run))]
    return render.write(page, _title(run), _subtitle(run), sections)


def _read_few(run: RunData) -> None:
    """Read what is short, once and whole; every part of it that is asked for would be read anew."""
    for group in run.groups.values():
        for variable in group.variables.values():
            if variable.size <= FEW:
                variable.load()


def _title(run: RunData) -> str:
    """Say what came out, in a line."""
    views = max((g.sizes.get("view", 0) for g in run.groups.values()), default=0)
    views = views or len(run.below("image"))
    seen = f" from {views} views" if views > 1 else " from one view" if views else ""
    if run.has("modes", "natural_frequency"):
        count = run.groups["modes"].sizes["mode"]
        tested = " and a finite element model put to the test" if "model" in run.groups else ""
        return f"{count or 'No'} mode{'s' * (count != 1)}{seen}{tested}"
    for field in run.fields().values():
        return f"Velocity field of {field.sizes['node']} nodes{seen}{_frequencies(field)}"
    point = run.groups.get("point")
    if point is not None:
        count = point.sizes.get("point", 1)
        of = f"of {count} points" if count > 1 else "of a point"
        return f"Velocity {of}{seen}{_frequencies(point)}"
    if run.below("image"):
        return f"Velocity images{seen}"
    return f"Pose of the instrument{seen}" if "pose" in run.groups else "Run of sldvexp"


def _frequencies(group: object) -> str:
    hertz = getattr(group, "coords", {}).get("frequency")
    if hertz is None:
        return ""
    return f" at {hertz.values[0]:g} Hz" if hertz.size == 1 else f" at {hertz.size} frequencies"


def _subtitle(run: RunData) -> str:
    """Say when, how long, and by what."""
    took = diagnostics.duration(run.attributes)
    packages = diagnostics.recorded_table(run.attributes, "packages")
    parts = [diagnostics.moment(run.attributes, "start"), f"sldvexp {packages.get('sldvexp', '')}"]
    if math.isfinite(took):
        parts.insert(1, f"took {took:.3g} s")
    parts.append(f"seed {run.attributes.get('seed', '')}")
    return " · ".join(parts)
