"""Help pages: each fits its terminal with nothing cut, and its examples are calls that work."""

from __future__ import annotations

import pytest

from sldvexp.cli import help as help_pages
from sldvexp.cli.commands import COMMANDS

PAGES = [(), *((name,) for name in COMMANDS)]


@pytest.mark.one_in(4)
@pytest.mark.parametrize("columns", [80, 120, 200])
@pytest.mark.parametrize("words", PAGES, ids=" ".join)
def test_help_fits_its_terminal_with_nothing_cut(sldvexp, monkeypatch, columns, words):
    told = {}
    for width in (columns, 1000):
        monkeypatch.setenv("COLUMNS", str(width))
        done = sldvexp(*words, "--help")
        assert (done.status, done.err) == (0, "")
        told[width] = done.out
    assert max(map(len, told[columns].splitlines())) <= columns
    assert sorted(told[columns].split()) == sorted(told[1000].split())


def test_every_command_has_a_page_with_examples(sldvexp):
    assert set(help_pages.COMMAND_HELP) == set(COMMANDS)
    for name, one in help_pages.COMMAND_HELP.items():
        out = sldvexp(name, "--help").out
        assert out.startswith(f"usage: sldvexp {name} ")
        assert out == sldvexp("help", name).out
        assert one.examples
        for call, _ in one.examples:
            assert f"sldvexp {call}" in out
            assert name in call.split()


def test_list_show_and_handbook_fit_a_narrow_terminal(sldvexp, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for words in (["list"], ["show", "pose=edge"], ["show", "experiment=plate"], ["handbook"]):
        out = sldvexp(*words).out
        assert [line for line in out.splitlines() if len(line) > 80 and "/" not in line] == []
        assert [line for line in out.splitlines() if line.endswith(" ...")] == []
