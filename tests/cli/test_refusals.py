"""A refused value is told by the type of its place, wherever the place is."""

from __future__ import annotations

import os

import pytest

from sldvexp.errors import UserError


@pytest.mark.one_in(8)
@pytest.mark.parametrize(
    ("setting", "told"),
    {
        "laser.board=[1]": "laser.board cannot be [1]; Valid: bits_12_sign, bits_16",
        "laser.up_down.polynomial=[1,b]": "laser.up_down.polynomial[1] must be a number, not b",
        "volume.size=[null,1]": "volume.size[0] must have a value, not null",
        "laser.up_down.polynomial={a:1}": "laser.up_down.polynomial must be a list, as in [a, b]",
        "pose.adjust={mirror_offset:null}": "pose.adjust.mirror_offset must have a value, not null",
        "expect.x={at_most:{5:1}}": "expect.x.at_most.5 has a number where the others have names",
        "overwrite=maybe": "overwrite must be true or false, not maybe",
        "sweep.rank={a:1}": "sweep.rank must be text, not {'a': 1}",
        "seed=${laser.board}": "seed must be a whole number, not Board.bits_12_sign",
        "sweep.retry=x": "sweep.retry cannot be x; Valid: all, failed, missing, unfinished",
        "~laser.up_down.gain": "laser.up_down.gain cannot be deleted, only changed",
        "~pose.nope": "~pose.nope deletes what is not there",
    }.items(),
)
def test_refused_value(sldvexp, setting, told):
    done = sldvexp("experiment=pose", "volume=grid", setting)
    assert (done.status, done.err) == (1, f"sldvexp: command line: {told}\n")


@pytest.mark.whole
def test_bare_off_in_a_file_is_told_from_a_word(sldvexp, tmp_path):
    mine = tmp_path / "lab" / "experiment" / "mine.yaml"
    mine.parent.mkdir(parents=True)
    text = "# @package _global_\ndefaults: [point, _self_]\nreconstruction: {robust: off}\n"
    called = ("--config-dir", "lab", "experiment=mine", "report=none")
    mine.write_text(text)
    done = sldvexp(*called)
    told = "reconstruction.robust must be in quotes, 'off': YAML reads the bare word as false"
    assert done.err == f"sldvexp: lab/experiment/mine.yaml: {told}\n"
    mine.write_text(text.replace("off", "'off'"))
    assert sldvexp(*called).status == 0


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("entries", "told"),
    {
        "{a:{x:0,y:0}}": ".a has a name where the others have numbers",
        "{1:5}": " has an entry 5 that must be a table, as in {name: value}",
        "{1:null}": ".1 must have a value, not null",
        "{1:{x:b}}": ".1.x must be a number, not b",
    }.items(),
)
def test_refused_entry(sldvexp, entries, told):
    done = sldvexp("~experiment", "target=fiducials", f"target.fiducials={entries}")
    assert (done.status, done.err) == (1, f"sldvexp: command line: target.fiducials{told}\n")


@pytest.mark.parametrize("name", ["sweep.nc", "run.nc", "x.nc"])
def test_report_of_a_pipe_says_that_it_is_none_of_a_file(sldvexp, tmp_path, name):
    (tmp_path / "x").mkdir()
    os.mkfifo(tmp_path / "x" / name)
    said = f"sldvexp: {tmp_path}/x/{name}: is a device or a pipe; a file is needed\n"
    assert sldvexp("report", f"{tmp_path}/x/{name}").err == said
    if name != "x.nc":
        assert sldvexp("report", f"{tmp_path}/x").err == said


@pytest.mark.one_in(2)
@pytest.mark.parametrize("more", [(), ("-m", "seed=1,2")])
@pytest.mark.parametrize("fault", [UserError("lab/x.yaml: is gone"), OSError("is gone")])
def test_fault_among_tables_is_a_warning_and_no_job_ends_by_it(sldvexp, monkeypatch, more, fault):
    def stumble(*_):
        raise fault
        yield ""

    monkeypatch.setattr("sldvexp.config.mixed_tables.mixed_tables", stumble)
    done = sldvexp("~experiment", "target=dissertation", "report=none", *more)
    assert done.status == 0, done.err
    said = "it is not known which entries of tables come from an example: "
    assert said in done.err + done.out
    assert "is gone\n" in done.err + done.out
    assert "Traceback" not in done.err + done.out
