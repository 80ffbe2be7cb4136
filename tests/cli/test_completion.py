"""Shell completion: what is offered when TAB is pressed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from sldvexp.config import registry

SCRIPT = Path(sys.executable).with_name("sldvexp")


@pytest.fixture
def offered(sldvexp, monkeypatch):
    """What is offered for a line that was typed so far."""

    def ask(line, shell="bash"):
        monkeypatch.setenv("COMP_LINE", line)
        done = sldvexp("-sc", f"query={shell}")
        assert (done.status, done.err) == (0, "")
        return done.out.split()

    return ask


def test_groups_settings_and_commands_are_offered_first(offered):
    found = offered("sldvexp ")
    assert {"list", "show", "seed=", "check."} < set(found)
    assert {"pose", "reconstruction"} < {word.rstrip("=.") for word in found}
    assert not {"data", "profile="} & set(found)  # folders of files that are no group
    assert not {"list", "show"} & set(offered("sldvexp seed=1 "))


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("line", "endings"),
    [
        ("sldvexp reconstr", "uction uction."),
        (
            "sldvexp reconstruction=",
            "absolute absolute_full combined contravariant relative samplewise shell spline",
        ),
        ("sldvexp reconstruction=co", "mbined ntravariant"),
        ("sldvexp -m pose=edge,bit", "angent"),
        ("sldvexp experiment=dissertation/point_", "conventions measured simulated"),
        ("sldvexp experiment=pose pose.inv", "erted."),
        ("sldvexp experiment=pose reconstruction=absolute reconstruction.weights=", "equal noise"),
        ("sldvexp experiment=dissertation/automated_pose pose.pinhole=", "false true"),
        ("sldvexp compare.x.plugin=re", "lative"),
        ("sldvexp list reco", "nstruction"),
        ("sldvexp show reco", "nstruction="),
        ("sldvexp show reconstruction=re", "lative"),
        ("sldvexp show check=pose_rep", "eats"),
        ("sldvexp --config-d", "ir"),
        ("sldvexp --config-dir lab experiment=mo", "nday"),
        ("sldvexp list --config-dir lab po", "se"),
    ],
)
def test_last_word_goes_on(offered, tmp_path, line, endings):
    monday = tmp_path / "lab/experiment/monday.yaml"
    monday.parent.mkdir(parents=True)
    monday.write_text("# @package _global_\n")
    assert offered(line) == [line.split()[-1] + ending for ending in endings.split()]


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    "line",
    [
        "sldvexp experiment=nope pose.",
        "sldvexp pose=bitangent pose.path.nothing.",
        "sldvexp --config-dir nowhere experiment=nope pose.",
        "sldvexp 'pose.adjust={a",
        "sldvexp nope=",
        "sldvexp --cfg nope pose.",
        "sldvexp list nope",
    ],
)
def test_wrong_line_gets_no_message(offered, line):
    assert offered(line) == []


def test_query_by_hand_and_unknown_shell_get_one_sentence(sldvexp, monkeypatch):
    monkeypatch.delenv("COMP_LINE", raising=False)
    assert sldvexp("-sc", "query=bash").err == (
        "sldvexp: command line: query= is asked by the shell; -sc install=bash sets it up\n"
    )
    assert sldvexp("-sc", "install=tcsh").err == (
        "sldvexp: command line: -sc does not know the shell tcsh; Valid: bash, fish, zsh\n"
    )


@pytest.mark.whole
def test_bash_completes_after_the_line_of_the_readme(tmp_path):
    line = "sldvexp reconstruction=contra"
    script = f"""
        set -e
        PATH="{SCRIPT.parent}:$PATH"
        eval "$(sldvexp -sc install=bash)"
        complete -p sldvexp
        COMP_LINE='{line}' COMP_POINT={len(line)} COMP_CWORD=1
        hydra_bash_completion
        echo "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    rule, words = done.stdout.splitlines()
    assert rule.endswith("-F hydra_bash_completion sldvexp")
    assert words == "reconstruction=contravariant"


def test_plugins_of_every_group_are_offered(offered):
    for group in registry.GROUPS:
        names = {word.partition("=")[2] for word in offered(f"sldvexp show {group}=")}
        assert names >= set(registry.BUILT_IN[group])
