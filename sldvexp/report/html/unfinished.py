"""Page of a run that was interrupted or failed: what there is so far, and how to go on.

It is made of what is in the folder: the settings and the command line that Hydra records, the log,
and the scan lines and answers of the journal.
"""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from sldvexp.config.paths import JOURNAL
from sldvexp.dataset import read_yaml
from sldvexp.errors import UserError
from sldvexp.files import read_text
from sldvexp.limits import YAML_BYTES
from sldvexp.report.html import render
from sldvexp.report.html.blocks import Code, Facts, HtmlTable, Lead, More, Section, Text, having
from sldvexp.session.interruption import LINES_KEPT, SCAN_KEPT, has_lines

LOG_FILE = "sldvexp.log"
#: Of a log, whose last lines count.
LOG_BYTES = 20_000_000
#: What Hydra keeps of a run.
CONFIG, OVERRIDES = Path(".hydra/config.yaml"), Path(".hydra/overrides.yaml")
#: A line of the log: when, who, how grave, and the text.
LINE = re.compile(r"\[([\d-]+ [\d:]+)[,\d]*\]\[([\w.]+)\]\[([A-Z]+)\] - (.*)")
STEPS = "sldvexp.pipeline.runner"
#: Kinds of files in a journal, by their names.
KINDS = {"coarse": "coarse lines", "fine": "fine lines", "image": "lines of the image"}
#: What the end of a run's last sentence tells, and a page by itself.
KEPT = re.compile(f"; (?:{LINES_KEPT}|{SCAN_KEPT}).*", re.DOTALL)
STOPPED = re.compile(r"interrupted|stopped", re.IGNORECASE)


class Logged(NamedTuple):
    """A line of the log."""

    time: str
    of: str
    text: str


def unfinished_because(folder: Path) -> str:
    """Explain why a folder is no unfinished run; empty if it is one."""
    there = (folder / CONFIG).is_file() or (folder / JOURNAL).is_dir()
    return "" if there else "it has neither the settings of a run nor a journal of scan lines"


def write(folder: Path, page: Path, reason: str = "") -> Path:
    """Make the page of a run that has no dataset.

    Parameters
    ----------
    folder : Path
        Of the run.
    page : Path
        Where to.
    reason : str
        The sentence that it ended with; without it the last of the log.
    """
    lines = list(_log(folder))
    steps, ended = _ended(lines)
    reason = reason or ended
    stopped = not reason or STOPPED.match(reason) is not None
    title = "Interrupted run" if stopped else "Failed run"
    why = KEPT.sub("", reason).strip().rstrip(".")
    told: list[Text | Code] = [
        Text(f"{title}: there is no result yet.", "verdict warning"),
        *([Text(f"{why[0].upper()}{why[1:]}.")] if why not in ("", "interrupted") else []),
        *_how_to_go_on(folder, stopped, SCAN_KEPT in reason),
    ]
    sections = [
        Section("Result", [Lead(told, _so_far(folder, steps))], unseen=True),
        Section("Log", _logged(lines, reason)),
        Section("Settings", _settings(folder)),
        Section("Provenance", _provenance(folder)),
    ]
    when = f"begun {steps[0].time}" if steps else "nothing is known of when it began"
    return render.write(page, title, f"{folder.absolute().name} · {when}", sections)


def _log(folder: Path) -> Iterator[Logged]:
    """Read the log; what is no line of ours belongs to the line before it."""
    file = folder / LOG_FILE
    if not file.is_file() or file.stat().st_size > LOG_BYTES:
        return
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        if found := LINE.fullmatch(line):
            yield Logged(found[1], found[2], found[4])


def _ended(lines: list[Logged]) -> tuple[list[Logged], str]:
    """Find the steps that were begun, and the sentence at the end, if there is one."""
    steps = [line for line in lines if line.of == STEPS and len(line.text.split()) <= 6]
    last = lines[-1] if lines else None
    return steps, last.text if last is not None and last not in steps else ""


def _how_to_go_on(folder: Path, stopped: bool, scanned: bool) -> Iterator[Text | Code]:
    """Tell the next command: what was measured is not measured again.

    What runs of any configuration is told first.
    """
    where = folder.absolute()
    resume = f"sldvexp {shlex.quote(f'resume={where}')}"
    if has_lines(folder):
        path = shlex.quote(f"instrument.path={where}")
        own = [word for word in _command(folder) if not word.startswith("instrument")]
        again = Code(shlex.join(["sldvexp", *own, "instrument=replay"]) + f" {path}")
        if scanned and not stopped:
            yield Text(
                "The scan is kept. Mend the configuration's file, or add settings that differ "
                "at the end of the command that goes on from it:"
            )
            yield Code(resume)
            yield Text(
                "Or, with another target or laser and where no file sets the instrument, the "
                "command, to be mended:"
            )
            yield again
            return
        yield Text("What was scanned is kept. To go on from there:")
        yield Code(resume)
        if not stopped:
            yield Text("Or, with other settings, the command, to be mended, on this scan:")
            yield again
    elif (folder / OVERRIDES).is_file():
        mended = "" if stopped else ", when what it ended with is mended"
        yield Text(f"Nothing was measured yet. To begin once more with the same settings{mended}:")
        yield Code(resume)


def _so_far(folder: Path, steps: list[Logged]) -> list[HtmlTable | Text]:
    """Show the steps that were begun, and what the journal has."""
    rows = [[s.time, s.text, "done" if s is not steps[-1] else "not finished"] for s in steps]
    kept = [[view, *counts] for view, counts in _kept(folder).items()]
    columns = ["view", *KINDS.values(), "others"]
    return having(
        HtmlTable(["begun", "step", "state"], rows, "Steps", (1,)) if rows else None,
        HtmlTable(columns, kept, "Kept of the scan, files") if kept else None,
        None if rows or kept else Text("There is nothing so far but the settings."),
    )


def _kept(folder: Path) -> dict[str, list[str]]:
    """Count the files of the journal by view and kind."""
    found = {}
    views = sorted(p for p in (folder / JOURNAL).glob("*") if p.is_dir())
    for view in views:
        kinds = Counter(
            next((kind for kind in KINDS if kind in file.stem), "others")
            for file in view.rglob("*")
            if file.is_file()
        )
        found[view.name] = [str(kinds[kind]) for kind in (*KINDS, "others")]
    return found


def _logged(lines: list[Logged], reason: str) -> list[Code | Text]:
    """Show the end of the log, and the sentence at its end, which may be told before it is kept."""
    if not lines:
        return [Text("There is no log.")]
    shown = [f"{line.time}  {line.text}" for line in lines[-MOST_LINES:]]
    if reason and reason not in (line.text for line in lines):
        shown.append(reason)
    return [Code("\n".join(shown))]


#: Lines of a log that a page shows.
MOST_LINES = 60


def _settings(folder: Path) -> list[More | Text]:
    """Show the whole configuration."""
    try:
        text = read_text(folder / CONFIG, YAML_BYTES)
    except (UserError, OSError):
        return [Text("The folder does not tell its settings.")]
    return [More("The whole configuration", [Code(text)])]


def _provenance(folder: Path) -> list[Facts | Text | Code]:
    """Tell the folder, and the command that the run was started with."""
    facts = Facts([("folder", str(folder.absolute()))])
    if not (folder / OVERRIDES).is_file():
        return [facts]
    line = shlex.join(["sldvexp", *_command(folder)])
    return [facts, Text("It was started with:"), Code(line)]


def _command(folder: Path) -> list[str]:
    """Read the settings that a run was started with; none if the folder does not tell."""
    try:
        words = read_yaml(read_text(folder / OVERRIDES, YAML_BYTES)) or []
    except (UserError, OSError, ValueError):
        return []
    return [str(word) for word in words]
