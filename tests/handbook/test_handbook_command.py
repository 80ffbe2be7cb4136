"""`sldvexp handbook`: the list of topics, and the pages."""

from __future__ import annotations

import re

import pytest

from sldvexp.cli import handbook
from sldvexp.config.paths import HANDBOOK

TOPICS = sorted(page.stem for page in HANDBOOK.glob("*.md"))


def test_list_has_a_line_for_every_topic(sldvexp):
    done = sldvexp("handbook")
    assert (done.status, done.err) == (0, "")
    *lines, empty, last = done.out.splitlines()
    named = [line.split()[0] for line in lines if re.match("  [a-z]", line)]
    assert sorted(named) == sorted([*TOPICS, *handbook.MADE])
    assert (empty, last.split(",")[0]) == ("", "sldvexp handbook page shows one of them")
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize("topic", TOPICS)
def test_page_goes_to_a_file_as_it_is(sldvexp, topic):
    done = sldvexp("handbook", topic)
    assert (done.status, done.err) == (0, "")
    assert done.out == (HANDBOOK / f"{topic}.md").read_text(encoding="utf-8")


@pytest.mark.one_in(12)
@pytest.mark.parametrize("topic", TOPICS)
def test_terminal_gets_headings_and_tables_that_are_set(sldvexp, monkeypatch, topic):
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich then takes any output for a terminal
    monkeypatch.setenv("COLUMNS", "100")
    done = sldvexp("handbook", topic)
    assert (done.status, done.err) == (0, "")
    assert "\x1b[" in done.out
    assert "|---|" not in done.out
    assert "\n## " not in done.out


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ([""], "there is no page without a name, and none has the word"),
        (["-"], "there is no page -, and none has the word"),
        (["glosary"], "there is no page glosary, and none has the word; did you mean glossary? "),
        (["../handbook/glossary"], "there is no page ../handbook/glossary, and none has"),
        (["glossary", "conventions"], "handbook takes one page or word, not glossary conventions"),
    ],
)
def test_wrong_topic_gets_one_sentence(sldvexp, words, answer):
    done = sldvexp("handbook", *words)
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(f"sldvexp: command line: {answer}")
    assert done.err.count("\n") == 1


def test_part_of_a_name_is_enough(sldvexp):
    assert sldvexp("handbook", "reading").out.startswith("# Reading a result\n")


def test_word_is_found_in_sections(sldvexp):
    done = sldvexp("handbook", "LINPACK")
    assert done.status == 0
    assert "  printed" in done.out
    assert "Points: Section 5.2; Fields: Table 5.7" in done.out


#: Words that users look for, and the page that tells most of each.
LOOKED_FOR = {
    "hum": "response_functions",
    "dropout": "verdict",
    "leakage": "glossary",
    "mains": "response_functions",
    "mirror": "conventions",
    "jitter": "glossary",
    "speckle": "planning",
    "hysteresis": "poses",
    "saturated": "glossary",
    "drift": "verdict",
    "occlusion": "glossary",
    "drop-outs": "verdict",
}


@pytest.mark.parametrize("word", LOOKED_FOR)
def test_words_are_found_within_pages_best_first(sldvexp, word):
    done = sldvexp("handbook", word)
    assert (done.status, done.err) == (0, "")
    first, *_ = (line.split() for line in done.out.splitlines() if line.startswith("  "))
    assert first[0] == LOOKED_FOR[word]


def test_words_within_others_do_not_count_where_there_is_the_word_itself(sldvexp):
    assert "remains" in (HANDBOOK / "glossary.md").read_text(encoding="utf-8")
    assert "  glossary" not in sldvexp("handbook", "mains").out
    assert "  own_files" in sldvexp("handbook", "igitize").out  # of which nothing is known else


@pytest.mark.whole
@pytest.mark.parametrize("arguments", [[], TOPICS[:1]])
def test_command_loads_neither_numpy_nor_other_heavy_libraries(loaded_by, arguments):
    code = "from sldvexp.cli import main; main.main()"
    told = "import atexit, sys; atexit.register(lambda: print('numpy._core' in sys.modules))"
    heavy, out = loaded_by(f"{told}; {code}", "handbook", *arguments)
    assert heavy == ""
    assert out.splitlines()[-1] == "False"


def test_help_and_completion_know_it(sldvexp, monkeypatch):
    assert "  handbook [page, word or site=folder]" in sldvexp("--help").out
    monkeypatch.setenv("COMP_LINE", "sldvexp handbook ")
    assert sldvexp("-sc", "query=bash").out.split() == sorted([*TOPICS, *handbook.MADE])
    monkeypatch.setenv("COMP_LINE", "sldvexp hand")
    assert sldvexp("-sc", "query=bash").out.split() == ["handbook"]
