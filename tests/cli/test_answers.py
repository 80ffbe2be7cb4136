"""Answers of help and ``--cfg job`` are kept: the same words again, while nothing changes them."""

from __future__ import annotations

import sys
from importlib import metadata

import pytest
import yaml
from omegaconf import OmegaConf, open_dict

from sldvexp.cli import answers, changed_answers, command, main
from sldvexp.cli.changed_answers import with_numbers
from sldvexp.config import Origins, hydra_plugin, kept, registry
from sldvexp.config.kept import CACHE

KEPT = (["list", "--help"], ["--cfg", "job"], ["experiment=point", "-c", "job"])
NOT_KEPT = (
    [],
    ["experiment=point"],
    ["--cfg", "all"],
    ["--cfg", "hydra"],
    ["--cfg", "job", "--resolve"],
    ["--cfg", "job", "--config-dir", "lab"],
    ["--cfg", "job", "hydra.searchpath=[file://lab]"],
    ["--cfg", "job", "+hydra.job.name=a"],
    ["--cfg", "job", "seed=${oc.env:SEED}"],
    ["--cfg", "job", "resume=run"],
    ["--help", "--config-dir", "lab"],
    ["job", "--cfg", "package"],
)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    return tmp_path / "cache" / CACHE


@pytest.fixture
def said(monkeypatch, capsys):
    """What the command prints, and how often the program was asked."""
    asked, usual = [], command.Command.run

    def counted(self):
        asked.append(self.arguments)
        return usual(self)

    monkeypatch.setattr(command.Command, "run", counted)

    def say(*arguments):
        monkeypatch.setattr(sys, "argv", ["sldvexp", *arguments])
        status = 0
        try:
            main.main()
        except SystemExit as done:
            status = done.code or 0
        return status, *capsys.readouterr(), len(asked)

    return say


@pytest.mark.one_in(3)
@pytest.mark.parametrize("arguments", KEPT, ids=" ".join)
def test_the_same_words_are_said_again(cache, said, arguments):
    first, again = said(*arguments), said(*arguments)
    assert first == again
    assert first[0] == 0
    assert first[1]
    assert first[3] == 1


@pytest.mark.parametrize("alone", ["--help", "-h"])
def test_the_page_of_all_needs_no_hydra(cache, said, monkeypatch, alone):
    pages = [said(alone), said(alone), said("help")]
    assert [page[3] for page in pages] == [0, 0, 1]
    assert {page[:3] for page in pages} == {(0, pages[0][1], "")}
    assert pages[0][1]


def test_packages_of_others_are_asked_for_the_page_of_all(cache, said, monkeypatch):
    entry = metadata.EntryPoint("theirs", "no_such_module", registry.ENTRY_POINTS)
    monkeypatch.setattr(metadata, "entry_points", lambda group: (entry,))
    registry.load_installed.cache_clear()
    with pytest.warns(registry.PluginWarning):
        assert said("--help")[3] == 1
    registry.load_installed.cache_clear()


@pytest.mark.parametrize("arguments", NOT_KEPT, ids=" ".join)
def test_questions_that_more_decides_are_no_questions(arguments):
    assert not answers.question(arguments)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("wrong", [["experiment=poin", "--cfg", "job"], ["--cfg", "job", "sed=1"]])
def test_mistakes_are_found_each_time(cache, said, wrong):
    first, again = said(*wrong), said(*wrong)
    assert first[:3] == again[:3]
    assert (first[0], first[3], again[3]) == (1, 1, 2)


def test_other_widths_and_packages_are_other_questions(cache, monkeypatch, tmp_path):
    names = [answers.question(["--help"])]
    monkeypatch.setenv("COLUMNS", "77")
    names.append(answers.question(["--help"]))
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    names.append(answers.question(["--help"]))
    (tmp_path / "installed").mkdir()
    names.append(answers.question(["--help"]))
    assert len(set(names)) == 4


def test_a_configuration_has_no_width(monkeypatch):
    before = answers.question(["--cfg", "job"])
    monkeypatch.setenv("COLUMNS", "77")
    assert answers.question(["--cfg", "job"]) == before


def test_what_packages_have_a_say_in_is_not_kept(cache, said, monkeypatch):
    monkeypatch.setattr(hydra_plugin, "others_search", lambda: True)
    asked = "experiment=point", "--cfg", "job"
    assert [said(*asked)[3], said(*asked)[3]] == [1, 2]


def test_a_spoilt_answer_is_not_given(cache, said):
    first = said("list", "--help")
    [file] = cache.iterdir()
    file.write_bytes(file.read_bytes()[:-1])
    assert said("list", "--help") == (*first[:3], 2)


@pytest.mark.whole
def test_without_a_cache_the_program_answers(said, monkeypatch):
    monkeypatch.setattr(kept, "private_folder", lambda name: "")
    first = said("--cfg", "job")
    assert said("--cfg", "job") == (*first[:3], 2)


def page_of(*settings):
    """The page of a configuration, as nothing but composing makes it."""
    composed = Origins(settings).compose()
    with open_dict(composed):
        del composed["hydra"]
    return OmegaConf.to_yaml(composed)


def numbers_of(node, above=""):
    """Another number of its kind for every entry of tables that holds one."""
    for key, value in node.items():
        if isinstance(value, dict):
            yield from numbers_of(value, f"{above}{key}.")
        elif isinstance(value, bool | int | float) and abs(value) < 1e15:
            other = not value if isinstance(value, bool) else value / 2 + 1 if value % 1 else value
            text = str(other).lower() if isinstance(value, bool) else f"{other + type(value)(3)}"
            if changed_answers.NUMBER.fullmatch(f"{above}{key}={text}"):
                yield f"{above}{key}", text


@pytest.mark.one_in(3)
@pytest.mark.parametrize("experiment", ["pose", "plate", "point"])
def test_every_number_is_changed_as_composing_changes_it(experiment):
    page = page_of(f"experiment={experiment}")
    numbers = {k: v for k, v in numbers_of(yaml.safe_load(page)) if with_numbers(page, {k: v})}
    assert len(numbers) > 10
    settings = [f"{key}={number}" for key, number in numbers.items()]
    whole = page_of(f"experiment={experiment}", *settings)
    assert with_numbers(page, numbers) == whole
    assert whole != page


CHANGED = (
    (["experiment=point", "seed=3"], ["experiment=point", "seed=5"]),
    ([], ["seed=5", "seed=6", "overwrite=true"]),
    (["seed=3"], ["seed=4"]),
    (["volume.shape=[9,7]"], ["seed=5", "volume.shape=[9,7]"]),
    (["laser.mirror_offset=0.25"], ["laser.mirror_offset=0.0000125"]),
)


@pytest.mark.one_in(5)
@pytest.mark.parametrize(("before", "then"), CHANGED, ids=str)
def test_other_numbers_need_no_program(cache, said, before, then):
    said("--cfg", "job", *before)
    changed = said("--cfg", "job", *then)
    assert (changed[0], changed[3]) == (0, 1)
    assert changed[1] == page_of(*then)


#: Settings of which one may say what the other one does, and numbers of another kind.
OF_THE_PROGRAM = (
    (["experiment=point", "seed=3"], ["experiment=point", "seed=0.5"]),
    (["seed=3"], ["seed=0.5"]),
    (["overwrite=true"], ["overwrite=1"]),
    ([], ["laser.mirror_offset=1"]),
    ([], ["pose.no_such_thing=1"]),
    ([], ["target=5"]),
    ([], ["volume.layers=7", "volume.layers=${seed}"]),
    ([], ["++volume={layers:5}", "volume.layers=7"]),
    ([], ["volume.samples.line=5", "volume.samples={line:6}"]),
)


@pytest.mark.one_in(9)
@pytest.mark.parametrize(("before", "then"), OF_THE_PROGRAM, ids=str)
def test_numbers_that_may_mean_more_are_asked_of_the_program(cache, said, before, then):
    said("--cfg", "job", *before)
    assert said("--cfg", "job", *then)[3] == 2
