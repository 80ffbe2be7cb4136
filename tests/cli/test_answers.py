"""Answers of help and ``--cfg job`` are kept: the same words again, while nothing changes them."""

from __future__ import annotations

import sys

import pytest

from sldvexp.cli import answers, command, main
from sldvexp.config import hydra_plugin, kept
from sldvexp.config.kept import CACHE

KEPT = (["--help"], ["list", "--help"], ["--cfg", "job"], ["experiment=point", "-c", "job"])
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


@pytest.mark.parametrize("arguments", KEPT, ids=" ".join)
def test_the_same_words_are_said_again(cache, said, arguments):
    first, again = said(*arguments), said(*arguments)
    assert first == again
    assert first[0] == 0
    assert first[1]
    assert first[3] == 1


@pytest.mark.parametrize("arguments", NOT_KEPT, ids=" ".join)
def test_questions_that_more_decides_are_no_questions(arguments):
    assert not answers.question(arguments)


@pytest.mark.parametrize("wrong", [["--cfg", "job", "sed=1"], ["experiment=poin", "--cfg", "job"]])
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


def test_what_packages_have_a_say_in_is_not_kept(cache, said, monkeypatch):
    monkeypatch.setattr(hydra_plugin, "others_search", lambda: True)
    assert [said("--cfg", "job")[3], said("--cfg", "job")[3]] == [1, 2]


def test_a_spoilt_answer_is_not_given(cache, said):
    first = said("--help")
    [file] = cache.iterdir()
    file.write_bytes(file.read_bytes()[:-1])
    assert said("--help") == (*first[:3], 2)


def test_without_a_cache_the_program_answers(said, monkeypatch):
    monkeypatch.setattr(kept, "_folder", lambda: "")
    first = said("--cfg", "job")
    assert said("--cfg", "job") == (*first[:3], 2)
