"""A run's folder that somebody else wrote can set values of a run and nothing else."""

from __future__ import annotations

import shutil

import pytest
import yaml

QUICK = ("~experiment", "target=dissertation")
WRITES = (
    "+hydra.callbacks.x={_target_: pathlib.Path.write_text, "
    "self: {_target_: pathlib.Path, _args_: [written]}, data: code}"
)


@pytest.fixture
def unfinished(sldvexp, tmp_path):
    """The folder of a run that was cut off before its end."""
    folder = tmp_path / "given"
    assert sldvexp(*QUICK, f"hydra.run.dir={folder}").status == 0
    (folder / "run.nc").unlink()
    return folder


def test_an_honest_folder_goes_on(sldvexp, unfinished):
    assert sldvexp(f"resume={unfinished}").status == 0
    assert (unfinished / "run.nc").is_file()


@pytest.mark.one_in(8)
@pytest.mark.parametrize(
    ("line", "told"),
    [
        (WRITES, "cannot set anything of Hydra's"),
        (
            "+hydra/callbacks=x",
            "cannot set anything of Hydra's",
        ),
        ("+a@hydra.callbacks=x", "cannot set anything of Hydra's"),
        ("hydra.searchpath=[file://elsewhere]", "cannot set anything of Hydra's"),
        ("hydra.job_logging.handlers.file.filename=written", "cannot set anything of Hydra's"),
        ("~hydra.sweeper", "cannot set anything of Hydra's"),
        ("+hydra={callbacks: {x: {_target_: os.abort}}}", "cannot set anything of Hydra's"),
        ("+scene.x={_target_: os.abort}", "cannot name code"),
        ("+check.x={plugin: truth, y: [{_partial_: true}]}", "cannot name code"),
        ("-m", "is no setting of a run"),
        ("--config-path=elsewhere", "is no setting of a run"),
        ("--experimental-rerun=pickle", "is no setting of a run"),
        ("no setting", "is no setting of a run"),
        (["seed=1"], "is no setting of a run"),
        ("seed=${oc.env:HOME}", "refers to something"),
        ("seed=1,2", "is for a sweep"),
    ],
)
def test_no_more_than_settings_of_a_run(sldvexp, unfinished, tmp_path, line, told):
    overrides = unfinished / ".hydra" / "overrides.yaml"
    overrides.write_text(yaml.safe_dump([*QUICK, line]))
    before = sorted(tmp_path.rglob("*"))
    done = sldvexp(f"resume={unfinished}")
    assert done.status == 1
    assert done.err.count("\n") == 1, done.err
    assert done.err.startswith("sldvexp: given/.hydra/overrides.yaml: ")
    assert told in done.err
    assert sorted(tmp_path.rglob("*")) == before


def test_a_file_that_is_chosen_from_elsewhere_cannot_name_code(sldvexp, unfinished, tmp_path):
    from sldvexp.config.paths import conf_dir

    own = tmp_path / "own.yaml"
    own.write_text("# @package _global_\nhydra: {callbacks: {x: {_target_: os.abort}}}\n")
    up = "../" * len((conf_dir() / "experiment").parts)
    overrides = unfinished / ".hydra" / "overrides.yaml"
    overrides.write_text(yaml.safe_dump([f"experiment={up}{str(own)[1:].removesuffix('.yaml')}"]))
    done = sldvexp(f"resume={unfinished}")
    assert done.status == 1
    assert "own.yaml: hydra.callbacks.x._target_ is refused" in done.err


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("runtime", 3),
        ("runtime", {"cwd": "/gone", "config_sources": []}),
        ("runtime", {"cwd": ["."], "config_sources": []}),
        ("job", {"config_name": "--cfg"}),
        ("job", {}),
    ],
)
def test_what_hydra_left_is_data(sldvexp, unfinished, key, value):
    kept = unfinished / ".hydra" / "hydra.yaml"
    settings = yaml.safe_load(kept.read_text())
    settings["hydra"][key] = value
    kept.write_text(yaml.safe_dump(settings))
    done = sldvexp(f"resume={unfinished}")
    assert done.status == 1
    assert done.err.startswith("sldvexp: given/.hydra/hydra.yaml: ")
    assert done.err.count("\n") == 1


@pytest.mark.one_in(2)
@pytest.mark.parametrize("content", ["{", "!!python/object/apply:os.abort []", "\0", "3"])
def test_files_that_hydra_did_not_write(sldvexp, unfinished, content):
    for name in ("overrides.yaml", "hydra.yaml"):
        shutil.copy(unfinished / ".hydra" / name, unfinished / name)
        (unfinished / ".hydra" / name).write_text(content)
        done = sldvexp(f"resume={unfinished}")
        assert done.status == 1
        assert name in done.err
        shutil.move(unfinished / name, unfinished / ".hydra" / name)
