"""What the pages of the handbook say is so: code runs, names exist, tables are the program's."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import fields

import pytest

from sldvexp.cli import main, plot
from sldvexp.cli.commands import COMMANDS
from sldvexp.config import Origins, registry
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import HANDBOOK
from sldvexp.dataset import AXES, CONVENTIONS, VARIABLES
from sldvexp.plot import FIGURES
from sldvexp.signal import Flag
from sldvexp.stopping import SIGNALS, Stopped, exit_status

PAGES = {page.stem: page.read_text(encoding="utf-8") for page in sorted(HANDBOOK.glob("*.md"))}
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

#: Heading in the glossary above names of classes and functions.
CODE = "In the program's code"
#: What a command line may set besides the groups' plugins.
SETTINGS = (*(f.name for f in fields(Experiment)), "experiment", "hydra", "resume")
#: Attributes that other programs ask for, or that say nothing of the run.
UNTOLD = ("Conventions", "title")
#: The session that bare `sldvexp` runs, with few pixels and nodes.
SMALL = ("volume.shape=[9, 7]", "volume.layers=3", "scan.structure.pixels=[17, 21]", "report=none")


def code(topic: str, language: str) -> list[str]:
    """The code blocks of a page in a language."""
    return [block for name, block in FENCE.findall(PAGES[topic]) if name == language]


def quoted(topic: str) -> list[str]:
    """What stands between backquotes in the text of a page."""
    return re.findall(r"`([^`]+)`", FENCE.sub("", PAGES[topic]))


def sections(topic: str) -> dict[str, str]:
    """Texts of a page by the headings above them."""
    parts = re.split(r"^#+ (.*)$", FENCE.sub("", PAGES[topic]), flags=re.MULTILINE)
    return dict(zip((t.replace("`", "") for t in parts[1::2]), parts[2::2], strict=True))


def rows(text: str) -> list[list[str]]:
    """Rows of all tables in a text, without headers and backquotes."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip().replace("`", "") for cell in line.split("|")[1:-1]] for line in lines]
    ruled = [i for i, row in enumerate(cells) if set("".join(row)) == {"-"}]
    return [row for i, row in enumerate(cells) if i not in ruled and i + 1 not in ruled]


def test_every_page_begins_with_a_title_and_what_it_is_for():
    assert {"conventions", "glossary", "printed", "reading_a_result"} <= set(PAGES)
    for topic, text in PAGES.items():
        title, paragraph, *_ = text.split("\n\n")
        assert re.fullmatch(r"# [A-Z].*", title), topic
        assert re.match(r"[A-Z]\w", paragraph), topic
        assert paragraph.endswith("."), topic


def test_code_runs_on_a_run_and_attributes_of_a_run_are_told(
    sldvexp: Callable, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    done = sldvexp(*SMALL)
    assert done.status == main.MISSED, done.err  # a page shows what was missed
    monkeypatch.chdir(done.folder)
    ran = 0
    for topic in PAGES:
        names: dict[str, object] = {}
        for block in code(topic, "python"):
            exec(compile(block, f"handbook/{topic}.md", "exec"), names)
            ran += 1
    assert ran >= 10
    out = capsys.readouterr().out
    assert "samplewise: examined/samplewise/relative_error[component=z]" in out
    assert re.search(r"^[-+.\dj]+ \+- [.\d]+ m/s$", out, re.MULTILINE)
    told = {group_of(title): text for title, text in sections("reading_a_result").items()}
    for node in done.tree.subtree:
        group = re.sub(r"^(edge|image)/.*", r"\1", node.path.strip("/")) or "The root"
        group = re.sub(r"^compare/.*", "field", group)
        missing = {name for name in node.attrs if f"`{name}`" not in told.get(group, "")}
        assert group.startswith("examined/") or missing <= {*CONVENTIONS, *UNTOLD}, group


def group_of(name: str) -> str:
    """The group of `VARIABLES` that a page's name of a group stands for."""
    return re.sub(r"/<\w+>$", "", name)


def test_tables_of_variables_are_those_of_the_dataset():
    found: dict[str, set[str]] = {}
    for title, text in sections("reading_a_result").items():
        group = group_of(title)
        if group not in VARIABLES:
            continue
        for name, *told in (row for row in rows(text) if len(row) == 4):
            known = VARIABLES[group][name]
            assert told[:2] == [known.dims, known.units], (group, name)
            assert told[2], (group, name)
            assert name not in found.setdefault(group, set()), (group, name)
            found[group].add(name)
    stages = [group for group in VARIABLES if not group.startswith("examined")]
    assert found == {group: set(VARIABLES[group]) for group in stages}


@pytest.mark.parametrize("topic", PAGES)
def test_every_variable_that_a_page_names_exists(topic):
    named, parents = 0, {group.partition("/")[0] for group in VARIABLES}
    for text in quoted(topic):
        path, _, name = text.partition("[")[0].rpartition("/")
        group = group_of(path)
        if group in VARIABLES and re.fullmatch(r"\w+", name):
            assert name in VARIABLES[group], text
            named += 1
        elif group_of(text) not in VARIABLES:
            assert path.partition("/")[0] not in parents or "<" in text, text
    assert named > 0


def test_flags_are_those_of_pixels():
    told = rows(sections("reading_a_result")["image/<view>"])
    flags = [(int(row[0]), row[1]) for row in told if len(row) == 3]
    assert flags == [(flag.value, flag.name) for flag in Flag]
    glossary = {row[0]: row[1] for row in rows(PAGES["glossary"])}
    assert all(str(flag.name) in glossary["flag"] for flag in Flag)


def test_conventions_are_those_that_every_run_states():
    assert dict(rows(sections("conventions")["Stated in every run"])) == CONVENTIONS
    told = rows(sections("conventions")["Names and numbers"])
    axes = {
        name: tuple(labels.partition(";")[0].split(", "))
        for names, labels in told
        for name in names.split(", ")
    }
    assert axes == AXES


def test_exit_statuses_are_those_of_the_command():
    told = {int(status) for status, _ in rows(sections("reading_a_result")["Exit status"])}
    stopped = {exit_status(Stopped(number)) for number in SIGNALS}
    assert told == {main.DONE, main.FAILED, main.MISSED, *stopped}


def test_glossary_has_each_word_once_and_in_order():
    words: list[str] = []
    for theme, text in sections("glossary").items():
        here = [row[0] for row in rows(text)]
        if theme != CODE:
            assert here == sorted(here, key=str.casefold), theme
            words += [word for name in here for word in name.split(", ")]
    assert len(words) > 100
    assert len(words) == len(set(words))


def test_names_of_the_code_exist():
    files = (HANDBOOK.parent).rglob("*.py")
    source = "\n".join(file.read_text(encoding="utf-8") for file in files)
    known = set(re.findall(r"^(?:class |def |)([A-Za-z_]+)(?: = |[(:\[])", source, re.MULTILINE))
    told = {n for row in rows(sections("glossary")[CODE]) for n in row[0].split(", ")}
    assert told - known == set()


def command_lines() -> list[str]:
    """Calls of the command, in blocks for a shell and between backquotes."""
    found = []
    for topic in PAGES:
        found += [line for block in code(topic, "sh") for line in block.splitlines()]
        found += [text for text in quoted(topic) if text.startswith("sldvexp ")]
    return sorted(set(found))


def wrong(line: str) -> str:
    """What is wrong with a call of the command; empty if nothing is."""
    words = shlex.split(line, comments=True)[1:]
    command = words.pop(0) if "=" not in words[0] else ""
    if command and command not in COMMANDS:
        return f"there is no command {command}"
    options = [word.removeprefix("--") for word in words if word.startswith("--")]
    if unknown := [o for o in options if command == "plot" and o not in plot.OPTIONS]:
        return f"plot has no option {unknown[0]}"
    if command == "plot":  # each option takes the word behind it
        words = [w for i, w in enumerate(words) if "--" not in (w[:2], words[i - 1][:2])]
    known = {"handbook": PAGES, "plot": FIGURES, "export": registry.names("export")}.get(command)
    if known is not None:
        given = words if command == "handbook" else words[1:]
        return ", ".join(word for word in given if word not in known)
    for key, _, value in (word.partition("=") for word in words if "=" in word):
        root = key.partition(".")[0]
        if root not in (*registry.GROUPS, *SETTINGS):
            return f"there is no setting {root}"
        if key in registry.GROUPS:
            valid = {*Origins([]).options_of(key), *registry.names(key)}
            if value not in valid:
                return f"there is no {key}={value}"
    return ""


def test_mistakes_in_calls_of_the_command_are_seen():
    good = "sldvexp rerun outputs/<day>/<time>   # again"
    assert wrong(good) == ""
    for bad in (
        "sldvexp rerunn outputs/<day>/<time>",
        "sldvexp handbook glosary",
        "sldvexp export outputs/<day>/<time> vtuu",
        "sldvexp show check=truths",
        "sldvexp pose=edgy seed=1",
        "sldvexp poze.path=mine.reg",
        "sldvexp plot outputs/<day>/<time> fild --width 85mm",
        "sldvexp plot outputs/<day>/<time> field --widht 85mm",
    ):
        assert wrong(bad), bad


@pytest.mark.parametrize("line", command_lines())
def test_calls_of_the_command_are_valid(line):
    assert line.startswith("sldvexp")
    assert wrong(line) == ""


def test_tests_that_hold_the_threats_exist():
    root = HANDBOOK.parents[1]
    named = [text for text in quoted("threats") if text.startswith("tests/")]
    assert len(named) > 5
    assert all((root / text).exists() for text in named)
