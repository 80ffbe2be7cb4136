"""`sldvexp list` and `sldvexp show`: what can be chosen, what can be set, and what it means."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from importlib.metadata import version
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from sldvexp.cli import show
from sldvexp.config import docs, registry

ROOT = Path(__file__).parents[2]
PLUGINS = [(group, name) for group in registry.GROUPS for name in registry.BUILT_IN[group]]


def test_list_has_a_line_for_every_plugin_and_experiment(sldvexp):
    done = sldvexp("list")
    assert (done.status, done.err) == (0, "")
    blocks = {b.split("\n")[0]: b.split("\n")[1:] for b in done.out.split("\n\n")}
    for group, name in PLUGINS:
        told = docs.of_plugin(registry.get(group, name))
        entry = re.split(r"^(?=  \S)", "\n".join(blocks[group]), flags=re.MULTILINE)
        [line] = [" ".join(text.split()) for text in entry if text.startswith(f"  {name} ")]
        assert told != ""
        assert line.startswith(f"{name} {told}")
    experiments = ROOT / "conf/experiment"
    names = {str(f.relative_to(experiments).with_suffix("")) for f in experiments.rglob("*.yaml")}
    assert {line.split()[0] for line in blocks["experiment"] if line[2] != " "} == names
    assert max(map(len, done.out.splitlines())) <= 100


def test_list_of_one_group_names_the_files_that_set_it_up(sldvexp):
    out = sldvexp("list", "target").out
    assert out.startswith("target\n  circles  Circles measured with")
    assert "; target=dissertation, target=two_planes points " in " ".join(out.split())
    assert "reconstruction" not in out


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ("list poze", "there is no group poze, and nothing has it in its name or description; did"),
        ("list pose laser", "list takes one group or part of a name, not pose laser"),
        ("list -m", "list takes no option --multirun, only --config-dir"),
        ("list --config-dir nope", "there is no folder nope"),
        ("show", "show takes one group=name, as in reconstruction=absolute; sldvexp list"),
        ("show poze", "no name has poze in it; "),
        ("show xyzzy", "no name has xyzzy in it; sldvexp list lists all"),
        ("show pose=edge laser=ometron", "show takes one group=name, as in"),
        ("show pose=edgy", "there is no pose=edgy; did you mean edge? Valid: bitangent, "),
        ("show poze=edge", "there is no group poze; did you mean pose? Valid: "),
        ("show check=pose_repeta", "there is no check=pose_repeta; did you mean pose_repeats? "),
        ("show experiment=psoe", "there is no experiment=psoe; did you mean pose? Valid: "),
        ("show target=schema/circles", "there is no target=schema/circles; "),
        ("lst", "there is no command lst; did you mean list? Valid: "),
        ("nope", "there is no command nope; Valid: "),
        ("explain", "there is no command explain; did you mean show? Valid: "),
        ("list nope", "there is no group nope, and nothing has it in its name or description; V"),
    ],
)
def test_misuse_gets_one_sentence(sldvexp, arguments, answer):
    done = sldvexp(*arguments.split())
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(f"sldvexp: command line: {answer}")
    assert done.err.count("\n") == 1


def test_list_finds_a_word_in_names_and_descriptions(sldvexp):
    out = sldvexp("list", "Strain").out
    assert "\n  strain_truth " in out
    assert "\n  plate_strain " in out
    assert "\npose\n" not in out


@pytest.mark.parametrize(
    ("word", "choice"),
    [
        ("edge", "pose=edge"),
        ("pose=bit", "pose=bitangent"),
        ("samplew", "reconstruction=samplewise"),
    ],
)
def test_show_finds_a_choice_by_part_of_its_name(sldvexp, word, choice):
    assert sldvexp("show", word).out.startswith(f"{choice}\n\n")


@pytest.mark.parametrize(
    ("word", "choices"),
    [
        (
            "strain",
            [
                "check=strain_truth",
                "experiment=panel_strain",
                "experiment=plate_strain",
                "experiment=tube_strain",
            ],
        ),
        ("solver", ["solver=cholesky", "solver=direct", "solver=iterative"]),
    ],
)
def test_show_lists_what_a_word_may_mean(sldvexp, word, choices):
    first, *lines = sldvexp("show", word).out.splitlines()
    assert first == f"Several have {word}:"
    assert [line.split()[0] for line in lines if line[2] != " "] == choices


def test_show_tells_source_value_type_unit_and_meaning(sldvexp):
    done = sldvexp("show", "laser=ometron_16bit")
    assert (done.status, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0] == "laser=ometron_16bit"
    assert f"plugin  two_mirror, sldvexp.laser.two_mirror (sldvexp {version('sldvexp')})" in lines
    [file] = [line for line in lines if line.startswith("file ")]
    assert file.startswith("file    conf/laser/ometron_16bit.yaml: Ometron's scanning vibrometer")
    assert (
        "  mirror_offset: 0.0\n      float, m. Distance between the two axes (Eq 4.3)." in done.out
    )
    assert "  board: bits_16\n      one of bits_12_sign, bits_16" in done.out
    assert "  up_down.gain: 25.0\n" in done.out


def test_show_has_what_a_file_sets_before_what_a_plugin_does(sldvexp):
    assert registry.get("reconstruction", "combined").rows == "best"
    assert "  unit: inch\n      one of m, cm," in sldvexp("show", "target=two_planes").out
    assert "  unit: m\n      one of m, cm," in sldvexp("show", "target=circles").out


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("group", "name"), PLUGINS)
def test_every_plugin_can_be_shown(group, name):
    plugin = registry.get(group, name)
    page = "\n".join(show.plugin_lines(group, registry.schema_of(plugin), None))
    assert f"{name}, {plugin.__module__} (sldvexp" in page
    for one in fields(plugin):
        assert f"\n  {one.name}:" in page


@pytest.mark.whole
def test_every_choice_that_is_no_plugins_name_can_be_shown(sldvexp):
    files = [f for group in registry.GROUPS for f in (ROOT / "conf" / group).glob("*.yaml")]
    for file in files:
        group = file.parent.name
        if file.stem not in registry.BUILT_IN[group]:
            done = sldvexp("show", f"{group}={file.stem}")
            assert (done.status, done.err) == (0, ""), file
            assert f"file    conf/{group}/{file.name}: " in done.out


def test_check_has_no_file_and_is_shown(sldvexp):
    out = sldvexp("show", "check=pose_repeats").out
    assert "  repeats: 1000\n      int. How many.\n" in out


def test_show_tells_what_an_experiment_chooses_sets_and_expects(sldvexp):
    out = sldvexp("show", "experiment=dissertation/measured").out
    assert out.startswith("experiment=dissertation/measured\n\nThe instrument's own")
    assert "file  conf/experiment/dissertation/measured.yaml\n" in out
    assert "  pose=registration\n" in out
    assert "  instrument=file\n" in out
    part = out.partition("conf/experiment/dissertation/registration.yaml sets\n")[2]
    assert part.startswith("  pose.path: conf://data/figure_4_28.reg\n")
    assert "  expect.half_width: 1 compared with Eq 5.18\n" in out
    assert "dissertation/measured.yaml sets" not in out  # it only includes others
    assert "config.yaml sets" not in out


def test_mistake_in_a_file_is_told_with_its_name(sldvexp, tmp_path):
    target = tmp_path / "lab/target/mine.yaml"
    target.parent.mkdir(parents=True)
    target.write_text("defaults: [schema/circles@_here_, _self_]\naccurracy: 1\n")
    done = sldvexp("show", "--config-dir", "lab", "target=mine")
    assert done.status == 1
    assert done.err.startswith("sldvexp: lab/target/mine.yaml: target.accurracy is not a known")
    target.write_text("accuracy: 1\n")
    done = sldvexp("show", "--config-dir", "lab", "target=mine")
    assert done.err.startswith("sldvexp: lab/target/mine.yaml: has settings but no plugin; ")


def test_defect_of_a_command_is_not_called_a_mistake(sldvexp, monkeypatch):
    def stumble(*_):
        raise ZeroDivisionError

    monkeypatch.setattr("sldvexp.cli.list.run", stumble)
    with pytest.raises(ZeroDivisionError):
        sldvexp("list")


@pytest.mark.one_in(2)
@pytest.mark.parametrize("word", ["list", "--help"])
def test_reader_may_stop_reading(word):
    end, start = os.pipe()
    os.close(end)
    command = [sys.executable, "-m", "sldvexp.cli.main", word]
    with open(start, "wb") as nobody:
        done = subprocess.run(command, stdout=nobody, stderr=subprocess.PIPE, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


class Finish(Enum):
    matt = 1
    glossy = 2


@dataclass
class Spot:
    """Where the beam ends.

    Parameters
    ----------
    size : float, mm
        Its diameter.
    """

    size: float = 0.5


@dataclass
class Base:
    """Not this.

    Parameters
    ----------
    width, height : float, m
        Of the
        plate.
    name : str
        Replaced below.
    """

    width: float = 1.0
    height: float = 2.0
    name: str = "a"


@dataclass
class Derived(Base):
    """What it is. More about `it`.

    Second paragraph.

    Parameters
    ----------
    name : str
        A ``name``.
    finish : Finish
        Of the surface.
    spots : dict of str to Spot
        By name.
    given : float, rad
        Without a default.

    Raises
    ------
    width : never
        No field.
    """

    finish: Finish = Finish.matt
    given: float = "???"  # type: ignore[assignment]
    bare: int = 3
    spot: Spot = field(default_factory=Spot)
    spots: dict[str, Spot] = field(default_factory=dict)


@dataclass
class Silent:
    number: int = 1


def test_fields_are_read_from_the_docstrings_of_a_class_and_its_bases():
    values = {"name": "b", "width": 0.1, "given": "???", "finish": "glossy", "spots": {}}
    found = [(p.key, p.value, p.kind, p.meaning) for p in docs.parameters_of(Derived, values)]
    assert found == [
        ("width", "0.1", "float, m", "Of the plate."),
        ("height", "null", "float, m", "Of the plate."),
        ("name", "b", "str", "A name."),
        ("finish", "glossy", "one of matt, glossy", "Of the surface."),
        ("given", "(must be given)", "float, rad", "Without a default."),
        ("bare", "null", "int", ""),
        ("spot", "", "", "Where the beam ends."),
        ("spot.size", "null", "float, mm", "Its diameter."),
        ("spots", "{}", "dict of str to Spot", "By name. Where the beam ends."),
        ("spots.<name>.size", "0.5", "float, mm", "Its diameter."),
    ]


def test_description_ends_where_sections_begin():
    assert docs.description(Derived) == ["What it is. More about it.", "Second paragraph."]
    assert docs.of_plugin(Derived) == "What it is"
    assert docs.description(Silent) == []


def _classes(cls):
    """A dataclass and those of its fields."""
    yield cls
    for hint in get_type_hints(cls).values():
        for part in (hint, *get_args(hint)):
            if is_dataclass(part):
                yield from _classes(part)


@pytest.mark.parametrize(("group", "name"), PLUGINS)
def test_every_setting_of_every_plugin_is_documented(group, name):
    plugin = registry.get(group, name)
    assert {one.name for one in fields(plugin)} <= set(docs.documented(plugin))
    told = list(docs.parameters_of(plugin, {}))
    assert [p.key for p in told if "." not in p.key and not p.meaning] == []
    for cls in _classes(plugin):  # a small table may say it all in its first sentence
        missing = {one.name for one in fields(cls)} - set(docs.documented(cls))
        assert docs.description(cls) if missing else True, cls
