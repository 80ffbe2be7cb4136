"""Five lines that close a run: what was found, how good it is, the verdict, where, what next.

They are made of the run's dataset alone and stand on a terminal as in a file. All numbers, findings
and notes are in `sldvexp.report.terminal.closing_table`, which ``sldvexp show <folder>`` prints.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.text import Text

from sldvexp.dataset import FREQUENCY, VARIABLES, Finding, RunData, Severity, Source
from sldvexp.lazy import xarray as xr
from sldvexp.limits import shown
from sldvexp.report.base import REPORT_FILE, verdict_text
from sldvexp.report.key_numbers import key_numbers
from sldvexp.report.modal_tables import level_of, model_told, modes_told
from sldvexp.report.numbers import number, with_bound
from sldvexp.report.tables import thickness_taken
from sldvexp.report.terminal import COLOURS
from sldvexp.typing import Array

#: Finding of a run that ended before all of its steps were done.
STOPPED = "stopped"
MICRO = 1e6
#: Values of an image that a root mean square is taken of at most: some of its pixels do.
MOST_VALUES = 2**22


def print_closing(source: Source | RunData, files: Sequence[Path]) -> None:
    """Print the five lines, the verdict in its colour.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("point", {}, velocity=[0.02, 0.01, 0.03], confidence=[1e-4, 2e-4, 1e-4])
    >>> print_closing({"point": found}, [Path("run.nc"), Path("report.html")])
    found: velocity: x 20.00 ± 0.10, y 10.00 ± 0.20, z 30.00 ± 0.10 mm/s
    bounds: 95 %
    verdict: none, as nothing was tested
    files: run.nc, report.html
    next: sldvexp show . tells every number and note; or open report.html
    """
    run = RunData.from_source(source)
    console = Console()
    for label, text in closing_lines(run, files):
        line = Text(shown(f"{label}: {text}", len(label) + len(text) + 2))
        colour = COLOURS.get(text.partition(":")[0]) if label == "verdict" else None
        if colour:
            line.stylize(f"bold {colour}", 0, len(f"{label}: ") + len(text.partition(":")[0]))
        if not console.is_terminal:
            print(line.plain)
            continue
        console.print(line, soft_wrap=label == "files")


def closing_lines(run: RunData, files: Sequence[Path]) -> Iterator[tuple[str, str]]:
    """Make the lines, each a label and what it says.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> place = {"origin": [[0, 0, 1]], "origin_confidence": [[2e-4, 1e-4, 2e-4]]}
    >>> pose = group("pose", {"view": ["front"]}, **place)
    >>> next(closing_lines(RunData({"pose": pose}), [Path("run.nc")]))
    ('found', 'where the instrument stood in 1 view, every coordinate within ± 0.2 mm')
    """
    line, findings = verdict_text(run)
    yield "found", _found(run, findings)
    yield "bounds", "; ".join(filter(None, (_bounds(run), _pixels(run), _expected(run))))
    yield "verdict", _verdict(line, findings)
    folder = files[0].parent
    names = [file.relative_to(folder) if file.is_relative_to(folder) else file for file in files]
    yield "files", ", ".join(map(str, [_near(files[0]), *names[1:]]))
    yield "next", _next(run, findings, files)


def _found(run: RunData, findings: Sequence[Finding]) -> str:
    """Say what the run was made for, with bounds."""
    if stopped := next((f.text for f in findings if f.kind == STOPPED), ""):
        return stopped
    told = [modes_told(run), model_told(run)]
    key = key_numbers(run)
    if not any(told) and set(run.groups).isdisjoint(("field", "point")):
        told += [_images(run), _poses(run)]
    if key is not None and not any(told):
        for one in filter(None, (key, key.beside)):
            values = ", ".join(f"{row[0]} {row[1]}" for row in one.rows)
            title = f"{one.title[:1].lower()}{one.title[1:]}"
            if one is not key:
                title = title.removeprefix("velocity ").partition(" at ")[0]
            told.append(f"{title}: {values} {one.columns[1].rpartition(', ')[2]}")
    told.append(_strain(run))
    return "; ".join(filter(None, told)) or f"{', '.join(run.groups) or 'nothing'}"


def _images(run: RunData) -> str:
    """Say of how many views there are images, and of several frequencies where most moves."""
    images = list(run.below("image").values())
    if not images:
        return ""
    told = f"images of {len(images)} view{'s' * (len(images) != 1)}"
    first = images[0]
    if "velocity" not in first or first["velocity"].sizes.get("frequency", 1) < 2:
        return told
    each = (_mean_squares(image) for image in images if "velocity" in image)
    squares = next((found for found in each if np.isfinite(found).any()), None)
    if squares is None:
        return f"{told} without a good pixel"
    hertz, rms = first["frequency"].values, np.sqrt(squares)
    at = int(np.nanargmax(rms))
    velocity = VARIABLES["image"]["velocity"]
    return (
        f"{told} at {len(hertz)} frequencies from {hertz[0]:g} to {hertz[-1]:g} {FREQUENCY.units}, "
        f"most motion at {hertz[at]:g} {FREQUENCY.units}: r.m.s. "
        f"{number(velocity.factor * float(rms[at]), 3)} {velocity.shown_unit}"
    )


def _mean_squares(image: xr.Dataset) -> Array:
    """Compute the mean squares of an image by frequency, of some of its pixels; NaN of none."""
    some = image.isel(pixel=slice(None, None, -(-image["velocity"].size // MOST_VALUES)))
    good = some["flags"].values == 0 if "flags" in some else slice(None)
    squares = np.abs(some["velocity"].values[good]) ** 2
    count, total = np.isfinite(squares).sum(axis=0), np.nansum(squares, axis=0)
    return np.asarray(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0))


def _poses(run: RunData) -> str:
    """Say how well the instrument's places are known."""
    if not run.has("pose", "origin"):
        return ""
    pose, known = run.groups["pose"], VARIABLES["pose"]["origin"]
    count = pose.sizes["view"]
    told = f"where the instrument stood in {count} view{'s' * (count != 1)}"
    if "origin_confidence" not in pose or not np.isfinite(pose["origin_confidence"]).any():
        return f"{told}, without bounds"
    worst = float(np.nanmax(pose["origin_confidence"].values))
    return f"{told}, every coordinate within ± {number(known.factor * worst, 2)} {known.shown_unit}"


def _strain(run: RunData) -> str:
    """Say the largest extension with its bound, at which frequency and of which thickness."""
    name = next((n for n in ("strain", "modes/strain") if run.has(n, "principal_strain")), "")
    if not name:
        return ""
    strain = run.groups[name]
    first = strain["principal_strain"].isel(principal=0)
    size = first.values
    if not np.isfinite(size).any():
        return "no strain is determined"
    at = np.unravel_index(int(np.nanargmax(size)), size.shape)
    place = dict(zip(first.dims, at, strict=True))
    where = ""
    if "frequency" in place:
        hertz = float(strain["frequency"].values[place["frequency"]])
        mode = f"in mode {place['frequency'] + 1}, " if name != "strain" else ""
        where = f" {mode}at {hertz:.5g} {FREQUENCY.units}"
    taken = thickness_taken(strain)
    bound = float(strain["principal_confidence"].isel(principal=0).values[at])
    told = f"strain of the face up to {with_bound(MICRO * size[at], MICRO * bound)} microstrain"
    return f"{told}{where}" + (f", which rests on {taken}" if taken else "")


def _bounds(run: RunData) -> str:
    """Say how large bounds are in general, and of which level."""
    if modes_told(run):
        return f"{100 * level_of(run.groups['modes']):g} %"
    group: xr.Dataset | None = next(iter(run.fields().values()), run.groups.get("point"))
    level = f"{float((group.attrs if group is not None else {}).get('confidence_level', 0.95)):.0%}"
    level = level.replace("%", " %")
    if (key := key_numbers(run)) is None:
        return "none"
    if len(key.columns) < 4 or key.columns[0] != "component":
        return level
    unit = key.columns[-1].rpartition(", ")[2]
    values = ", ".join(f"{row[0]} {row[-1]}" for row in key.rows)
    return f"{level}, r.m.s. of them {values} {unit}"


def _pixels(run: RunData) -> str:
    """Say how many pixels of all images are flagged."""
    flags = [image["flags"].values for image in run.below("image").values() if "flags" in image]
    flagged = sum(int((f != 0).sum()) for f in flags)
    return f"{flagged} of {sum(map(len, flags))} pixels flagged" if flags else ""


def _expected(run: RunData) -> str:
    """Say how many expectations are met, and which are not."""
    if "check" not in run.groups:
        return ""
    check = run.groups["check"]
    passed = check["passed"].values.astype(bool)
    told = f"expected: {passed.sum()} of {len(passed)} met"
    if passed.all():
        return told
    more = f" and {(~passed).sum() - 1} more" if (~passed).sum() > 1 else ""
    return f"{told}, not {check['quantity'].values[~passed][0]}{more}"


def _verdict(line: str, findings: Sequence[Finding]) -> str:
    """Say the verdict and the worst of what speaks against the results."""
    if not line:
        return "none, as nothing was tested"
    against = [finding for finding in findings if finding.severity > Severity.note]
    notes = len(findings) - len(against)
    if not against:
        return f"{line}" + (f" ({notes} note{'s' * (notes != 1)})" if notes else "")
    rest = f" (and {len(against) - 1} more)" if len(against) > 1 else ""
    return f"{line}: {against[0].text}{rest}"


def _next(run: RunData, findings: Sequence[Finding], files: Sequence[Path]) -> str:
    """Say what to do next: repair what can be, read the numbers, open the page."""
    remedies = [f.remedy for f in findings if f.remedy and f.severity > Severity.note]
    folder = shlex.quote(str(_near(files[0].parent)))
    told = f"{remedies[0]}; " if remedies else ""
    told += f"sldvexp show {folder} tells every number and note"
    page = next((file for file in files if file.name == REPORT_FILE), None)
    return f"{told}; or open {_near(page)}" if page else told


def _near(path: Path) -> Path:
    """Name a path as seen from here, if it lies below."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path
