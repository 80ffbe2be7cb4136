"""What the pages of the handbook say is so: code runs, names exist, tables are the program's."""

from __future__ import annotations

import re
import shlex
from dataclasses import fields

import pytest
from handbook_pages import FENCE, PAGES, group_of, sections

from sldvexp.cli import command, plot, reference
from sldvexp.cli.commands import COMMANDS
from sldvexp.config import Origins, docs, registry
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import HANDBOOK
from sldvexp.dataset import AXES, CONVENTIONS, VARIABLES
from sldvexp.plot import FIGURES
from sldvexp.signal import Flag
from sldvexp.stopping import SIGNALS, Stopped, exit_status

#: Heading in the glossary above names of classes and functions.
CODE = "In the program's code"
#: What a command line may set besides the groups' plugins.
SETTINGS = (*(f.name for f in fields(Experiment)), "experiment", "hydra", "resume")


def code(topic: str, language: str) -> list[str]:
    """The code blocks of a page in a language."""
    return [block for name, block in FENCE.findall(PAGES[topic]) if name == language]


def quoted(topic: str) -> list[str]:
    """What stands between backquotes in the text of a page."""
    return re.findall(r"`([^`]+)`", FENCE.sub("", PAGES[topic]))


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


def test_pictures_exist_and_say_in_words_what_they_show():
    shown = [found for text in PAGES.values() for found in re.findall(r"!\[(.*?)\]\((.*?)\)", text)]
    assert len(shown) >= 3
    for told, file in shown:
        assert len(told) > 20
        assert (HANDBOOK / file).is_file(), file


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


def variables_named(topic: str) -> int:
    """Count the variables that a page names, all of which must exist."""
    named, parents = 0, {group.partition("/")[0] for group in VARIABLES}
    for text in quoted(topic):
        path, _, name = text.partition("[")[0].rpartition("/")
        group = group_of(path)
        if group_of(text) in VARIABLES:
            continue  # a group, also one below another
        if group in VARIABLES and re.fullmatch(r"\w+", name):
            assert name in VARIABLES[group], text
            named += 1
        elif group_of(text) not in VARIABLES:
            assert path.partition("/")[0] not in parents or "<" in text, text
    return named


def test_every_variable_that_a_page_names_exists():
    named = [variables_named(topic) for topic in PAGES]
    assert sum(n > 0 for n in named) > len(PAGES) / 2


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
    assert told == {command.DONE, command.FAILED, command.MISSED, *stopped}


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
        lines = [line for block in code(topic, "sh") for line in block.splitlines()]
        found += [line for line in lines if not line.startswith("pip install ")]
        found += [text for text in quoted(topic) if re.match("sldvexp [^<]*$", text)]
    return sorted(set(found))


def words_of(line: str) -> list[str]:
    """Words of a call without options."""
    words, left = [], shlex.split(line, comments=True)[1:]
    while left:
        word = left.pop(0)
        if word in ("--config-dir", "--cfg", "-sc", *(f"--{o}" for o in plot.OPTIONS)):
            left.pop(0)
        elif not word.startswith("-"):
            words.append(word)
    return words


def wrong(line: str) -> str:
    """What is wrong with a call of the command; empty if nothing is."""
    words = words_of(line)
    command = words.pop(0) if words and not re.search("[=~]", words[0]) else ""
    if command and command not in COMMANDS:
        return f"there is no command {command}"
    options = [w for w in shlex.split(line, comments=True) if w.startswith("--")]
    if command == "plot" and (odd := [o for o in options if o[2:] not in (*plot.OPTIONS, "help")]):
        return f"plot has no option {odd[0]}"
    known = {
        "handbook": [*PAGES, *reference.PAGES],
        "plot": FIGURES,
        "export": registry.names("export"),
    }.get(command)
    if known is not None:
        given = words if command == "handbook" else words[1:]
        named = (word.partition(".")[0] if "=" in word else word for word in given)
        return ", ".join(word for word in named if word not in known)
    for key, _, value in (word.partition("=") for word in words if "=" in word):
        root = re.split("[./]", key.lstrip("~+"))[0]
        if root not in (*registry.GROUPS, *SETTINGS):
            return f"there is no setting {root}"
        if key in registry.GROUPS:
            valid = {*Origins([]).options_of(key), *registry.names(key)}
            if lost := set(value.split(",")) - valid:
                return f"there is no {key}={lost.pop()}"
    return ""


def test_mistakes_in_calls_of_the_command_are_seen():
    good = "sldvexp rerun outputs/<day>/<time>   # again"
    assert wrong(good) == ""
    for bad in (
        "sldvexp rerunn outputs/<day>/<time>",
        "sldvexp handbook glosary",
        "sldvexp export outputs/<day>/<time> vtuu",
        "sldvexp export outputs/<day>/<time> vtu vtuu.phases=3",
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


def settings_of(group: str) -> set[str]:
    """Keys of all plugins of a group, with a star for a name of the user's."""
    plugins = [registry.get(group, name) for name in registry.BUILT_IN[group]]
    keys = {one.key for plugin in plugins for one in docs.parameters_of(plugin, {})}
    return {re.sub(r"<\w+>", "*", key) for key in keys}


@pytest.mark.parametrize("group", [g for g in registry.GROUPS if registry.BUILT_IN[g]])
def test_settings_that_pages_name_exist(group):
    known = settings_of(group)
    for topic in PAGES:
        for text in quoted(topic):
            found = re.fullmatch(rf"{group}\.(?!txt|html)([a-z_]+)((?:\.\w+)*)(?:=.*)?", text)
            if found and not (HANDBOOK.parent / group / f"{found[1]}.py").is_file():
                assert any(key.split(".")[0] == found[1] for key in known), (topic, text)


def test_settings_of_an_enumeration_take_the_values_that_pages_give():
    members: dict[str, set[str]] = {}
    for group in registry.GROUPS:
        for name in registry.BUILT_IN[group]:
            for one in docs.parameters_of(registry.get(group, name), {}):
                if one.kind.startswith("one of "):
                    values = one.kind.removeprefix("one of ").split(", ")
                    members.setdefault(f"{group}.{one.key}", set()).update(values)
    texts = [text for topic in PAGES for text in quoted(topic)]
    given = [text.split("=") for text in texts if re.fullmatch(r"[\w.]+=\w+", text)]
    checked = [(key, value) for key, value in given if key in members]
    assert [f"{key}={value}" for key, value in checked if value not in members[key]] == []
    assert len(checked) > 10
