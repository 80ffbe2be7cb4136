"""Runs of a sweep share what is the same, and come out as they would alone, to the bit."""

from __future__ import annotations

import json
import threading
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from omegaconf import OmegaConf

from sldvexp import dataset
from sldvexp.cli.rerun import AgreementLevel, compare
from sldvexp.config.experiment import Experiment
from sldvexp.pipeline import provenance
from sldvexp.pipeline.step import Run, Step, check_contracts
from sldvexp.pipeline.steps import STEPS
from sldvexp.sweep import Store, shared_steps
from sldvexp.sweep.plan import folder_name
from tests.composing import config, experiment

POSES = ("experiment=dissertation/automated_pose", "expect={}")
FIELDS = (
    "experiment=plate",
    "scan.structure.pixels=[9,11]",
    "volume.shape=[3,3]",
    "volume.layers=3",
    "check={}",
)


def loaded(path):
    with dataset.load(path) as tree:
        return tree.load()


def alike_with_and_without(sldvexp, tmp_path, fixed, swept, shared):
    """Every run of a sweep against the same run alone; how many reused each step."""
    key, _, values = swept.partition("=")
    sldvexp("-m", *fixed, swept, "hydra.sweep.dir=swept")
    reused = []
    for value in values.split(","):
        setting = f"{key}={value}"
        in_sweep = loaded(tmp_path / "swept" / folder_name([*fixed, setting]) / "run.nc")
        alone = sldvexp(*fixed, setting).tree
        unlike = [d for d in compare(alone, in_sweep) if d.kind is not AgreementLevel.identical]
        assert unlike == []
        dtypes = [{f"{n.path}/{k}": v.dtype for n in t.subtree for k, v in n.variables.items()}
                  for t in (alone, in_sweep)]  # fmt: skip
        assert dtypes[0] == dtypes[1]
        assert in_sweep.attrs["inputs_sha256"] == alone.attrs["inputs_sha256"]
        reused += in_sweep.attrs.get("reused_steps", "").split(", ")
    assert {step: reused.count(step) for step in shared} == shared


@pytest.mark.long
def test_poses_of_one_scan(sldvexp, tmp_path):
    alike_with_and_without(sldvexp, tmp_path, POSES, "pose=bitangent,edge", {"scan": 1, "pose": 0})


@pytest.mark.long
def test_fields_of_one_session(sldvexp, tmp_path):
    shared = dict.fromkeys(["scan", "pose", "volume", "comparison of the views"], 1)
    shared |= {"compared fields": 1, "velocity field": 0}
    swept = "reconstruction=absolute,relative"
    alike_with_and_without(sldvexp, tmp_path, FIELDS, swept, shared)


class Undeclared:
    """In the place of a plugin that a step must not look at."""

    def __getattribute__(self, name):
        raise AssertionError(f"a step reads {name} of a group that it does not declare")

    def __bool__(self):
        raise AssertionError("a step reads a group that it does not declare")


def as_declared(settings, tmp_path):
    """Do the steps of an experiment, shared ones with nothing but what they declare."""
    e = experiment(*settings)
    made = {}
    done = []
    for step in (s for s in STEPS if s.needed(e)):
        seen = {n: g for name, groups in made.items() for n, g in groups.items()
                if not step.shared or name in step.after(done)}  # fmt: skip
        hidden = {
            f.name: Undeclared() for f in fields(e) if step.shared and f.name not in step.keys
        }
        given = Experiment(**{f.name: hidden.get(f.name, getattr(e, f.name)) for f in fields(e)})
        rng = None if step.shared else np.random.default_rng(0)
        run = Run(given, rng, tmp_path, tree=dict(seen))
        step.work(run)
        made[step.name] = {n: g for n, g in run.tree.items() if seen.get(n) is not g}
        done.append(step)
        assert [n for n in seen if n not in run.tree] == []
        if step.name == "compared fields":
            break
    return [step.name for step in done if step.shared]


@pytest.mark.whole
def test_steps_read_what_they_declare(tmp_path):
    assert as_declared(POSES, tmp_path) == ["scan", "pose"]


@pytest.mark.long
def test_steps_of_fields_read_what_they_declare(tmp_path):
    done = as_declared(FIELDS, tmp_path)
    names = ["comparison of the views", "velocity field", "compared fields"]
    assert done == ["volume", "scan", "pose", *names]


# A step of no cost shows what decides whether it is done.


@pytest.fixture
def step():
    """A step that counts how often it is done and reads a file."""
    done = []

    def work(run):
        done.append(run)
        run.inputs.append("input.txt")
        run.tree["g/h"] = xr.Dataset(
            {"x": ("name", np.array([1.5, np.nan])), "z": ("name", [1 + 2j, 3j])},
            coords={"name": np.array(["a", "bcd"])},
            attrs={"one": [1.5], "text": "é", "number": np.float32(0.1), "array": np.arange(2)},
        )

    return SimpleNamespace(
        step=Step("a step", lambda e: True, work, makes=("g/",), reads=("seed", "laser")), done=done
    )


@pytest.fixture
def perform(step, tmp_path, monkeypatch):
    """Do that step as one run of a sweep would; whether it was reused, and what it gave."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "input.txt").write_text("1")
    cfgs = {}

    def call(*settings, work=step.step):
        if settings not in cfgs:
            cfgs[settings] = config("~experiment", *settings)
        run = Run(None, None, tmp_path)
        Store(cfgs[settings], tmp_path / ".shared")(work, run)
        assert run.inputs == ["input.txt"]
        return bool(run.reused), run.tree["g/h"]

    call()
    return call


def test_entry_is_what_was_kept(perform, step):
    _, made = perform("seed=1")
    reused, taken = perform("seed=1")
    assert reused
    xr.testing.assert_identical(made, taken)
    assert taken["name"].dtype == made["name"].dtype
    assert {k: type(v) for k, v in taken.attrs.items()} == {
        k: type(v) for k, v in made.attrs.items()
    }
    assert taken["x"].values.flags["C_CONTIGUOUS"]
    assert not taken["x"].encoding


@pytest.mark.whole
def test_what_a_step_reads_decides(perform):
    assert perform()[0]
    assert perform("target=dissertation")[0]  # which it does not read
    assert not perform("seed=1")[0]
    assert not perform("laser=ometron_16bit")[0]
    assert not perform("laser.mirror_offset=0.01")[0]


def test_input_files_decide(perform, tmp_path):
    (tmp_path / "input.txt").write_text("2")
    assert not perform()[0]
    assert perform()[0]


def test_versions_decide(perform, monkeypatch):
    monkeypatch.setattr(provenance, "versions", lambda: {"numpy": "0.1"})
    assert not perform()[0]


DAMAGES = {
    "one bit": lambda nc, about: nc.write_bytes(flipped(nc.read_bytes())),
    "cut": lambda nc, about: nc.write_bytes(nc.read_bytes()[:1000]),
    "empty": lambda nc, about: nc.write_bytes(b""),
    "gone": lambda nc, about: nc.unlink(),
    "note cut": lambda nc, about: about.write_text(about.read_text()[:30]),
    "note empty": lambda nc, about: about.write_text("{}"),
    "note of another kind": lambda nc, about: about.write_text("[1]"),
    "groups of another kind": lambda nc, about: about.write_text(
        json.dumps({**json.loads(about.read_text()), "groups": {"nothing": 1}})
    ),
}


def flipped(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.one_in(6)
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_entry_is_noticed_and_made_again(damage, perform, tmp_path, caplog):
    (entry,) = (tmp_path / ".shared").glob("*.nc")
    DAMAGES[damage](entry, entry.with_suffix(".json"))
    reused, group = perform()
    assert not reused
    assert "is damaged and is computed again" in caplog.text
    assert group["x"].values[0] == 1.5
    assert perform()[0]


def test_two_at_once_do_it_once(perform, step, monkeypatch):
    """The one that is first is at work until the others have come, too."""
    perform("seed=7", work=replace(step.step, name="another", reads=("laser",)))
    before, come, all_there = len(step.done), [], threading.Event()
    locked = shared_steps.locked

    def locked_after_coming(path):
        come.append(path)
        if len(come) == 3:
            all_there.set()
        return locked(path)

    def work(run):
        assert all_there.wait(300)
        step.step.work(run)

    monkeypatch.setattr(shared_steps, "locked", locked_after_coming)
    slow = replace(step.step, work=work)
    together = [
        threading.Thread(target=perform, args=("seed=7",), kwargs={"work": slow}) for _ in range(3)
    ]
    for thread in together:
        thread.start()
    for thread in together:
        thread.join()
    assert len(step.done) == before + 1


def test_step_after_another_depends_on_its_inputs(perform, tmp_path):
    cfg = config("~experiment")
    OmegaConf.set_readonly(cfg, True)
    first = Step("first", lambda e: True, lambda run: run.inputs.append("input.txt"), ("f",))

    def work(run):
        run.tree["g"] = xr.Dataset({"x": ("n", [1.0])})

    second = Step("second", lambda e: True, work, ("g",), needs=("f",), reads=("laser",))

    def reused():
        run, store = Run(None, None, tmp_path), Store(cfg, tmp_path / ".shared")
        store(first, run)
        store(second, run)
        return run.reused == ["second"]

    assert [reused(), reused()] == [False, True]
    (tmp_path / "input.txt").write_text("3")
    assert [reused(), reused()] == [False, True]


def test_a_step_adds_what_it_declares(tmp_path):
    def work(run):
        run.tree["pose"] = None
        run.tree["other/1"] = None

    step = Step("pose", bool, work, makes=("pose", "others/"))
    with pytest.raises(RuntimeError, match="adds other/1, which it does not declare"):
        step.perform(Run(None, None, tmp_path))
    replace(step, makes=("pose", "other/")).perform(Run(None, None, tmp_path))


@pytest.mark.parametrize(
    ("declared", "told"),
    [
        ({"reads": ("posse",)}, r"reads \['posse'\]"),
        ({"needs": ("images/",)}, r"needs \['images/'\]"),
        ({"needs": ("field",)}, r"needs \['field'\]"),
    ],
)
def test_contracts_that_cannot_be_true(declared, told):
    first = Step("first", bool, bool, makes=("image/", "pose"))
    check_contracts([first, Step("second", bool, bool, ("field",), needs=("image/a",))])
    with pytest.raises(ValueError, match=told):
        check_contracts([first, replace(Step("second", bool, bool, ("field",)), **declared)])


def test_what_a_step_needs_decides_its_shared_result():
    after = {step.name: step.after(STEPS[:i]) for i, step in enumerate(STEPS)}
    assert after["pose"] == ("calibration object", "scan")
    for fields_of in ("velocity field", "compared fields", "streamed fields"):
        assert set(after[fields_of]) == {
            "scan", "pose", "volume", "velocity images", "images of points",
            "comparison of the views",
        }  # fmt: skip
