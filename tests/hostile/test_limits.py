"""Limits where they are: what is just allowed, and what is just refused."""

from __future__ import annotations

import os
import re
import signal

import pytest
import yaml

from sldvexp import dataset, limits
from sldvexp.cli.commands import in_order, with_bare_names
from sldvexp.config.paths import conf_dir
from sldvexp.config.security import looks_up, require_bounded_line
from sldvexp.errors import UserError
from sldvexp.files import read_text
from sldvexp.writing import require_no_links

#: The usual parser, in C if there is one.
QUICK = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def nested(depth: int) -> str:
    return "[" * depth + "]" * depth


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("good", "bad", "told"),
    [
        (nested(60), nested(61), "more than 60 deep"),
        ("[" + "1," * 19_000 + "]", "[" + "1," * 20_001 + "]", "more than 20000 values"),
        (
            "{a: &a [" + "1," * 900 + "], b: [" + "*a," * 18 + "]}",
            "{a: &a [" + "1," * 900 + "], b: [" + "*a," * 23 + "]}",
            "more than 20000 values",
        ),
        ("a: &a [1, 2]\nb: *a\n", "a: &a [1, *a]\n", "a refers to itself"),
        ("a: '" + "${b}" * 30 + "'", "a: '" + "${b}" * 31 + "'", "more than 30 references"),
        ("# " + "x" * (2**20 - 2), "# " + "x" * 2**20, "more than 1 MB"),
    ],
)
def test_yaml_is_bounded(good, bad, told):
    limits.require_bounded_yaml(good)
    assert limits.load_yaml(good) == yaml.safe_load(good)
    with pytest.raises(limits.TooMuchError, match=told):
        limits.load_yaml(bad)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: 1\nb: 2\na: 3", "a is there twice, first in line 1"),
        ("circles:\n  3: {x: 1}\n  '3': {x: 2}", "circles.3 is there twice, first in line 2"),
        ("a: [{b: 1}, {b: 2, c: {d: 1, d: 2}}]", "a.c.d is there twice"),
        ("{? [1, 2] : 3, a: {b: 1}, c: {b: 2}, b: [a, a], a: 3}", "a is there twice"),
    ],
)
def test_a_key_that_is_twice_in_a_table_is_refused(text, told):
    with pytest.raises(limits.TooMuchError, match=re.escape(told)):
        limits.require_bounded_yaml(text)


def keys_that_are_twice(node):
    """List them by the usual parser's own tree, which has both."""
    if isinstance(node, yaml.SequenceNode):
        return [key for value in node.value for key in keys_that_are_twice(value)]
    if not isinstance(node, yaml.MappingNode):
        return []
    keys = [key.value for key, _ in node.value]
    below = [key for _, value in node.value for key in keys_that_are_twice(value)]
    return [key for key in set(keys) if keys.count(key) > 1] + below


def test_packaged_configurations_have_every_key_once():
    files = sorted(conf_dir().rglob("*.yaml"))
    assert len(files) > 100
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert keys_that_are_twice(yaml.compose(text, QUICK)) == [], file
        found = limits.load_yaml(text)
        assert found == yaml.load(text, QUICK), file
        again = f"{text}\n{next(iter(found))}: 1\n" if found else "a: 1\na: 2"
        assert len(keys_that_are_twice(yaml.compose(again, QUICK))) == 1
        with pytest.raises(limits.TooMuchError, match="is there twice, first in line"):
            limits.require_bounded_yaml(again)


def test_yaml_that_is_none_has_the_words_of_the_usual_parser():
    for text in ("a: [", "{", "a: b: c", "2026-99-99: 1", "!!python/object/apply:os.abort []"):
        with pytest.raises(yaml.YAMLError):
            limits.load_yaml(text)
    with pytest.raises(yaml.YAMLError, match="could not determine a constructor"):
        limits.load_yaml("!!python/object/apply:os.abort []")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"1,2\n" * 1_200_000, ""),
        (b"\n" * 3_000_001, "has more than 1500000 lines"),
        (b"x" * (2 * 2**20) + b"\n" + b"y", ""),
        (b"x\n" + b"x" * (2 * 2**20 + 1), "has a line of more than 2 MB, line 2"),
        (b"x\r" * 9 + b"x" * (3 * 2**20), "has a line of more than 2 MB, line 1"),
    ],
)
def test_text_is_bounded(tmp_path, content, told):
    assert limits.too_much_text(content) == told
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    if told:
        with pytest.raises(UserError, match=re.escape(told)):
            read_text(path)
    else:
        assert len(read_text(path)) == len(content)


@pytest.mark.parametrize("pattern", [r"([-+]?\d+),.*", "sldvexp,virtual lab,", "a{3}", "(ab|cd)*x"])
def test_patterns_of_profiles_are_quick(pattern):
    assert limits.slow_pattern(pattern) == ""


@pytest.mark.parametrize("pattern", ["(a+)+$", "(a*b?)*c", "((x|y){2,9}z)*", "(?:(?:a+)b)+"])
def test_patterns_that_may_take_for_ever_are_told(pattern):
    assert "repetition in a repetition" in limits.slow_pattern(pattern)


def test_process_that_is_ended_ends_nothing_else():
    assert limits.tried_apart(lambda: "found") == "found"
    with pytest.raises(ChildProcessError, match="it ends the library that reads it"):
        limits.tried_apart(lambda: os.kill(os.getpid(), signal.SIGKILL) or "")
    with pytest.raises(ChildProcessError, match="no such thing"):
        limits.tried_apart(lambda: {}["no such thing"])
    with pytest.raises(ChildProcessError):
        limits.tried_apart(lambda: str(len(bytes(2**30))))


def test_honest_run_is_within_its_limits(tmp_path):
    big = dataset.group("pose", {"view": [f"{i}" for i in range(5000)]}, s=[0.2] * 5000)
    dataset.save({"pose": big}, {}, tmp_path / "run.nc")
    dataset.store._bounded.clear()
    dataset.require_bounded(tmp_path / "run.nc")
    assert dataset.load(tmp_path / "run.nc")["pose/s"].size == 5000


@pytest.mark.parametrize(
    "text", ["${seed}", "outputs/${now:%Y-%m-%d}", "${hydra:job.num}", "$x", "{"]
)
def test_references_to_settings_stay(text):
    assert looks_up(text) == ""


@pytest.mark.parametrize(
    "text", ["${oc.env:HOME}", "a${oc.env:HOME,x}b", "${${a}:x}", "${oc.decode:${oc.env:A}}"]
)
def test_references_to_anything_else_are_told(text):
    assert "cannot look up" in looks_up(text)


@pytest.mark.parametrize(
    ("line", "ordered"),
    [
        (["a=1", "-m", "b=2"], ["a=1", "b=2", "-m"]),
        (["-m", "a=1"], ["a=1", "-m"]),
        (["list", "--config-dir", "my", "pose"], ["list", "pose", "--config-dir", "my"]),
        (["--config-dir=my", "a=-1", "-c", "job"], ["a=-1", "--config-dir=my", "-c", "job"]),
        (["--info", "a=1"], ["a=1", "--info"]),
        (["--info", "plugins", "~b"], ["~b", "--info", "plugins"]),
        (["--config-dir"], ["--config-dir"]),
        (["--evil", "a=1"], ["a=1", "--evil"]),
    ],
)
def test_options_may_stand_anywhere(line, ordered):
    from hydra._internal.utils import get_args_parser

    assert in_order(line, get_args_parser()) == ordered


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ('a={"1": {x: 1}}', "a={1: {x: 1}}"),
        ("a={'b c': 1, 'd': 2}", "a={b c: 1, d: 2}"),
        ("a={x: '{\"1\": 2}'}", "a={x: '{\"1\": 2}'}"),
        ('a={x: "b", "y": "c: d"}', 'a={x: "b", y: "c: d"}'),
        ("a=['b', 'c']", "a=['b', 'c']"),
        ("a={'b': ['c', 'd'], \"e\" : 1}", "a={b: ['c', 'd'], e: 1}"),
        ("a='{\"b\": 1}'", "a='{\"b\": 1}'"),
    ],
)
def test_names_in_tables_lose_their_quotes_and_values_keep_theirs(written, read):
    assert with_bare_names(written) == read


def test_lines_are_bounded():
    require_bounded_line("line", ["seed=range(1,20000)", f"a={nested(60)}", "b=" + "x" * 40_000])
    for bad in (
        ["seed=range(1,20002)"],
        ["a=1,2"] * 15,
        [f"a={nested(61)}"],
        ["b=" + "x" * 60_000],
    ):
        with pytest.raises(UserError, match=r"^line: "):
            require_bounded_line("line", bad)


def test_folder_that_is_a_link_may_be_one(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "run").symlink_to("data")
    require_no_links(tmp_path / "run")
    (tmp_path / "data/figures").symlink_to("..")
    with pytest.raises(UserError, match=r"figures: is a link to \.\., and what is written there"):
        require_no_links(tmp_path / "run")
