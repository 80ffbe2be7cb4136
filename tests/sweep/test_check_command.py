"""`sldvexp check`: what works, what is refused with which sentence, and numbers as expected."""

from __future__ import annotations

import re

import numpy as np
import pytest
import xarray as xr
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import strategies as st

from sldvexp.check import lookup
from sldvexp.cli.completion import suggestions
from sldvexp.errors import UserError
from sldvexp.sweep.matrix import PLAIN, as_setting, read_matrix

EXPERIMENT = "# @package _global_\ndefaults: [_self_, override /target: dissertation]\n"

MATRIX = """
axes: {seed: [1, -1], target: [dissertation, two_planes]}
settings: {experiment: null}
rules:
  - {when: {seed: -1}, refused: '^seed must be zero or a positive integer, not -1'}
"""


@pytest.fixture
def lab(tmp_path):
    """Leaves files in the user's folder `lab`."""

    def left(files):
        for name, text in files.items():
            file = tmp_path / "lab" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        return tmp_path / "lab"

    return left


def lines(done):
    """What is said of each combination, without the time that it took."""
    told = [line.rpartition(" (")[0] for line in done.out.splitlines()[:-1]]
    return {line[8:].partition(": ")[0]: (line[:6], line.partition(": ")[2]) for line in told}


@pytest.mark.whole
def test_folder_of_experiments_and_matrices(sldvexp, lab, tmp_path):
    visa = "instrument: {resource: 'TCPIP::127.0.0.1::1::SOCKET'}\n"
    defaults = "override /target: dissertation"
    lab(
        {
            "experiment/good.yaml": EXPERIMENT
            + "expect: {some: {at_most: {target/position: 1}}}\n",
            "experiment/bare.yaml": EXPERIMENT,
            "experiment/may/missed.yaml": EXPERIMENT
            + "expect: {some: {at_most: {target/position: 1e-6}}}\n",
            "experiment/misspelt.yaml": EXPERIMENT + "sede: 1\n",
            "experiment/no_file.yaml": EXPERIMENT.replace("]", ", override /pose: registration]")
            + "pose: {path: nowhere.reg}\n",
            "experiment/real.yaml": EXPERIMENT.replace(
                defaults, f"{defaults}, override /instrument: visa"
            )
            + visa,
            "matrix/seeds.yaml": MATRIX,
        }
    )
    done = sldvexp("check", "lab")
    assert done.status == 2
    told = lines(done)
    assert told["experiment=good"][0] == "passed"
    assert told["experiment=good"][1].endswith(" numbers as expected")
    assert told["experiment=bare"] == ("passed", "works; nothing is expected of its numbers")
    state, sentence = told["experiment=may/missed"]
    assert state == "FAILED"
    assert "numbers are not as expected: some: target/position[" in sentence
    assert sentence.endswith(", not at most 1e-06")
    state, sentence = told["experiment=misspelt"]
    assert (state, "sede is not a known setting; did you mean seed?" in sentence) == (
        "FAILED",
        True,
    )
    state, sentence = told["experiment=no_file"]
    assert (state, "nowhere.reg: there is no such file" in sentence) == ("FAILED", True)
    assert told["experiment=real"] == ("passed", "is in order; not run, as it needs an instrument")
    assert told["seed=1,target=two_planes"][0] == "passed"
    assert told["seed=-1,target=dissertation"] == (
        "passed",
        "refused, as it should be: seed must be zero or a positive integer, not -1",
    )
    assert done.out.splitlines()[-1].startswith("7 of 10 as expected; runs are in outputs/")
    assert len(list(tmp_path.glob("outputs/*/*/*/*/run.nc"))) == 5  # good, bare, missed, two seeds

    # One of them alone, and those of a folder.
    done = sldvexp("--config-dir", "lab", "check", "may")
    assert (done.status, list(lines(done))) == (2, ["experiment=may/missed"])
    done = sldvexp("check", "lab/experiment/may/missed.yaml", "lab/matrix/seeds.yaml")
    assert (done.status, next(iter(lines(done)))) == (2, "experiment=may/missed")
    assert done.out.splitlines()[-1].startswith("4 of 5 as expected")


@pytest.mark.whole
def test_other_sentence_or_none_is_not_as_expected(sldvexp, lab):
    text = MATRIX.replace("seed: -1}, refused: '^seed", "seed: [1, -1]}, refused: '^sede")
    done = sldvexp("check", str(lab({"m.yaml": text}) / "m.yaml"))
    told = lines(done)
    assert done.status == 2
    assert {state for state, _ in told.values()} == {"FAILED"}
    assert told["seed=1,target=dissertation"][1].startswith("works, but should be refused: ^sede")
    assert told["seed=-1,target=dissertation"][1] == (
        "seed must be zero or a positive integer, not -1"
    )


@pytest.mark.whole
def test_not_run(sldvexp, lab, tmp_path):
    text = MATRIX + "  - {when: {seed: 1}, run: false}\n"
    done = sldvexp("check", str(lab({"m.yaml": text}) / "m.yaml"))
    assert done.status == 0
    assert lines(done)["seed=1,target=two_planes"] == ("passed", "is in order")
    assert not (tmp_path / "outputs").exists()
    assert done.out.splitlines()[-1] == "4 of 4 as expected"


def test_later_rules_win(lab):
    text = """
axes: {seed: [1, 2]}
settings: {target: dissertation, laser.mirror_offset: 0.01}
expect: {a: {at_most: {x/y: 1}}}
rules:
  - {settings: {laser.mirror_offset: 0.02, experiment: null}, refused: first}
  - {when: {seed: 2}, settings: {laser.mirror_offset: 0.03}, refused: second,
     expect: {a: {at_most: {x/y: 2}}, b: {at_most: {x/z: 3}}}}
"""
    one, two = read_matrix(lab({"m.yaml": text}) / "m.yaml")
    assert one.name == "seed=1"
    assert set(one.settings) == {
        "target=dissertation",
        "laser.mirror_offset=0.02",
        "seed=1",
        "~experiment",
    }
    assert (one.refused, one.expect) == ("first", {"a": {"at_most": {"x/y": 1}}})
    assert "laser.mirror_offset=0.03" in two.settings
    assert two.refused == "second"
    assert two.expect == {"a": {"at_most": {"x/y": 2}}, "b": {"at_most": {"x/z": 3}}}


REFUSED = {
    "axes: {seed: 1}": "axes must name settings, each with a list of its values",
    "settings: {seed: 1}": "axes must name settings, each with a list of its values",
    "axes: {seed: [1]}\nrule: []": "rule is not a known setting; did you mean rules?",
    "axes: {seed: [1]}\nrules: [{wen: {}}]": "did you mean when?",
    "axes: {seed: [1]}\nrules: [{when: {sede: 1}}]": "there is no axis sede; did you mean seed?",
    "axes: {seed: [1]}\nrules: [{when: {seed: 2}}]": "rules[0].when: seed has no value 2; Valid: 1",
    "axes: {seed: [1]}\nrules: [{refused: '('}]": "rules[0].refused: is no regular expression",
    "axes: {seed: [1]}\nrules: [{run_of: {a.b: {pose: x}}}]": "run_of.a.b: there is no axis pose",
    "axes: {hydra/launcher: [basic]}": "hydra/launcher cannot be set here",
    "axes: {seed: [1]}\nsettings: {hydra.run.dir: x}": "hydra.run.dir cannot be set here",
    "axes: {seed: [1]}\nrules: [{settings: {hydra: {a: 1}}}]": "hydra cannot be set here",
    "axes: {seed: [1]}\nrules: [{lab: 'hydra.launcher._target_'}]": "cannot be set here",
    "axes: {seed: [1]}\nsettings: {'seed=1 hydra.x': 1}": "cannot be set here",
    "axes: [": "line 1: is not YAML",
    "- seed": "must be a table",
    "seed": "must be a table",
}


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_file_that_is_no_matrix(text, lab):
    with pytest.raises(UserError) as error:
        read_matrix(lab({"m.yaml": text}) / "m.yaml")
    assert REFUSED[text] in str(error.value)
    assert "lab/m.yaml" in str(error.value)


def test_code_that_a_matrix_names_is_refused_and_not_run(sldvexp, lab, tmp_path):
    text = f"""
axes: {{seed: [1]}}
settings: {{experiment: null, target: dissertation,
           target.label: {{_target_: os.mkdir, path: {tmp_path / "made"}}}}}
"""
    done = sldvexp("check", str(lab({"m.yaml": text}) / "m.yaml"))
    assert done.status == 2
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "check takes experiments, matrices, or a folder of yours"),
        (["plat"], "plat is no file, experiment or matrix; did you mean plate?"),
        (["empty"], "empty: has neither a folder experiment nor a folder matrix"),
        (["instruments", "nothing_like_it"], "nothing_like_it is no file"),
    ],
)
def test_word_that_stands_for_nothing(words, sentence, sldvexp, tmp_path):
    (tmp_path / "empty").mkdir()
    done = sldvexp("check", *words)
    assert (done.status, done.out) == (1, "")
    assert sentence in done.err


def test_shell_offers_experiments():
    assert {"plate", "plate_frf"} <= set(suggestions("sldvexp check pla"))
    assert suggestions("sldvexp check lab/") == []  # the shell offers files


VALUES = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(allow_nan=False, allow_infinity=False),
        st.text(st.characters(codec="ascii", exclude_categories=("C",), exclude_characters="\\$")),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.from_regex(r"[a-z]+", fullmatch=True), inner),
    ),
    max_leaves=6,
)


@pytest.mark.whole
@given(VALUES)
def test_values_arrive_as_they_are_written(value):
    require_arrives(value)


@pytest.mark.parametrize("value", [None, True, -3, 1.5e-7, "a, 'b'", "", [1, ["x=y"]], {"k": {}}])
def test_values_of_each_kind_arrive_as_they_are_written(value):
    require_arrives(value)


def require_arrives(value):
    (read,) = OverridesParser.create().parse_overrides([f"key={as_setting(value)}"])
    assert not read.is_sweep_override()
    assert _same(read.value(), value)


def _same(read, value):
    """Plain text that looks like something else is read as that, as on any command line."""
    if isinstance(value, dict):
        return {str(k) for k in read} == set(value) and all(
            _same(v, value[str(k)]) for k, v in read.items()
        )
    if isinstance(value, list):
        return len(read) == len(value) and all(map(_same, read, value))
    other = isinstance(value, str) and not isinstance(read, str)
    return read == value or (other and re.fullmatch(PLAIN, value))


def test_magnitudes_between_bars():
    tree = {
        "image": xr.Dataset({"velocity": ("pixel", np.array([3 + 4j, -2.0]))}, {"pixel": [0, 1]})
    }
    labels, numbers = lookup("|image/velocity|", tree)
    assert labels == ["[0]", "[1]"]
    assert numbers.tolist() == [5.0, 2.0]
    assert lookup("|image/velocity[pixel=1]|", tree)[1] == 2.0
