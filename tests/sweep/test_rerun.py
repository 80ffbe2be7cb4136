"""A run's file is enough to repeat the run; and whoever made the file cannot run code with it."""

from __future__ import annotations

import json
import re
import shutil

import netCDF4
import numpy as np
import pytest
import xarray as xr
import yaml

from sldvexp.cli.rerun import AgreementLevel, compare
from sldvexp.config.paths import conf_dir

FOLDER = conf_dir() / "experiment"
EXPERIMENTS = sorted(str(p.relative_to(FOLDER).with_suffix("")) for p in FOLDER.rglob("*.yaml"))
QUICK = ("digitizer", "dissertation/point_measured", "point", "pose")


def repeats(sldvexp, name):
    first = sldvexp(f"experiment={name}")
    again = sldvexp("rerun", str(first.folder / "run.nc"))
    assert (again.status, again.err) == (0, "")
    counts = re.search(r"(\d+) quantities: (\d+) bit-identical", again.out)
    assert counts[1] == counts[2] != "0"
    assert "packages: the same versions" in again.out
    path = again.out.splitlines()[-1]
    with netCDF4.Dataset(path) as new, netCDF4.Dataset(first.folder / "run.nc") as old:
        assert new.config == old.config
        assert new.plugins == old.plugins
    assert path != str(first.folder / "run.nc")


@pytest.mark.one_in(6)
@pytest.mark.parametrize("name", QUICK)
def test_repeats_to_the_bit(name, sldvexp):
    repeats(sldvexp, name)


@pytest.mark.long
@pytest.mark.parametrize("name", [e for e in EXPERIMENTS if e not in QUICK])
def test_every_experiment_repeats_to_the_bit(name, sldvexp):
    repeats(sldvexp, name)


@pytest.fixture
def point(sldvexp):
    """A run that read a file of the user's."""
    shutil.copy(conf_dir() / "data" / "point_example.csv", "mine.csv")
    return sldvexp("experiment=point", "instrument.path=mine.csv").folder


def changed(folder, **attributes):
    with netCDF4.Dataset(folder / "run.nc", "a") as file:
        for name, change in attributes.items():
            file.setncattr(name, change(file.getncattr(name)))


@pytest.mark.whole
def test_differences_are_told_quantity_by_quantity(point, sldvexp):
    with netCDF4.Dataset(point / "run.nc", "a", auto_complex=True) as file:
        std = file["point/velocity_std"]
        std[:] = std[:] * (1 + 1e-13)
        condition = file["point/rcond"]
        condition[:] = condition[:] * 1.5

    changed(point, packages=lambda text: text.replace(json.loads(text)["numpy"], "0.1"))
    done = sldvexp("rerun", str(point))
    assert done.status == 2
    assert re.search(r"^point/velocity_std: equal within rounding, by 1e-13", done.out, re.M)
    assert "point/rcond: different, by 0.33 of its largest entry" in done.out
    assert re.search("bit-identical, 1 equal within rounding, 1 different$", done.out, re.M)
    assert f"packages: numpy 0.1 -> {np.__version__}\n" in done.out


@pytest.mark.whole
def test_input_files_are_known_by_their_content(point, sldvexp, tmp_path, monkeypatch):
    mine = tmp_path / "mine.csv"
    content = mine.read_text()
    mine.write_text(content.replace("450", "451"))
    done = sldvexp("rerun", str(point))
    assert done.status == 1
    assert done.err.endswith("run.nc: the run read mine.csv, which has another content now\n")
    mine.unlink()
    done = sldvexp("rerun", str(point))
    assert "the run read mine.csv, which is not there (looked from " in done.err
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    mine.write_text(content)
    monkeypatch.chdir(elsewhere)  # the run's folder tells where the run was started
    assert sldvexp("rerun", str(point)).status == 0


def other(change):
    """A change of the configuration, as text."""

    def changed_text(text):
        values = yaml.safe_load(text)
        change(values)
        return yaml.safe_dump(values)

    return changed_text


CALL = {"_target_": "os.mkdir", "path": "pwned"}
HOSTILE = {
    "target of a plugin": (
        {"config": other(lambda c: c["instrument"].update(CALL))},
        "instrument._target_ is refused: a configuration names plugins and cannot name code",
    ),
    "target of the root": (
        {"config": other(lambda c: c.update(CALL))},
        "_target_ is refused: a configuration names plugins and cannot name code",
    ),
    "target of a named plugin": (
        {"config": other(lambda c: c.update(check={"x": {"plugin": "truth", **CALL}}))},
        "check.x._target_ is refused: a configuration names plugins and cannot name code",
    ),
    "target in a list": (
        {"config": other(lambda c: c["instrument"].update(path=[CALL]))},
        "instrument.path.0._target_ is refused: ",
    ),
    "resolver": (
        {"config": other(lambda c: c["instrument"].update(path="${oc.env:HOME}"))},
        "instrument.path is refused: a file refers to settings, as in ${seed}, and cannot look up",
    ),
    "resolver in a key": (
        {"config": other(lambda c: c.update(compare={"${oc.env:HOME}": {}}))},
        "compare.${oc.env:HOME} is refused: a file refers to settings",
    ),
    "hydra's callbacks": (
        {"config": other(lambda c: c.update(hydra={"callbacks": {"x": CALL}}))},
        "hydra.callbacks.x._target_ is refused",
    ),
    "hydra's launcher": (
        {"config": other(lambda c: c.update(hydra={"launcher": {"n_jobs": 2}}))},
        "hydra.launcher is refused",
    ),
    "hydra's own": (
        {"config": other(lambda c: c.update(hydra={"run": {"dir": "pwned"}}))},
        "hydra is not a known setting",
    ),
    "defaults": (
        {"config": other(lambda c: c.update(defaults=["experiment_schema"]))},
        "defaults is not a known setting",
    ),
    "object of Python in YAML": (
        {"config": lambda text: text + "\nx: !!python/object/apply:os.mkdir [pwned]\n"},
        "config: cannot be read: could not determine a constructor for the tag",
    ),
    "name of Python in YAML": (
        {"config": lambda text: text + "\nx: !!python/name:os.mkdir\n"},
        "config: cannot be read: could not determine a constructor for the tag",
    ),
    "plugin that is a module": (
        {"plugins": lambda text: json.dumps({**json.loads(text), "instrument": "os.mkdir"})},
        "plugins: instrument: there is no ",
    ),
    "plugin in a group": (
        {"config": other(lambda c: c.update(check={"x": {"plugin": "../../os.mkdir"}}))},
        "check.x.plugin",
    ),
    "no plugins": ({"plugins": lambda text: "{}"}, "does not say which plugin "),
    "no JSON": ({"plugins": lambda text: "["}, "plugins: cannot be read: "),
    "a list": ({"config": lambda text: "[1, 2]"}, "config: must be a table of names"),
}


@pytest.mark.one_in(18)
@pytest.mark.parametrize("way", HOSTILE)
def test_file_from_a_stranger_runs_no_code(way, point, sldvexp, tmp_path):
    attributes, sentence = HOSTILE[way]
    changed(point, **attributes)
    done = sldvexp("rerun", str(point))
    assert done.status == 1
    assert sentence in done.err
    assert len(done.err.splitlines()) == 1, done.err
    assert not (tmp_path / "pwned").exists()


@pytest.mark.whole
def test_measured_run_is_repeated_from_its_scan_lines_only(point, sldvexp):
    """A file from a stranger moves no instrument either."""
    settings = {"resource": "TCPIP::127.0.0.1::5025::SOCKET"}
    changed(
        point,
        plugins=lambda text: json.dumps({**json.loads(text), "instrument": "visa"}),
        config=other(lambda c: c.update(instrument=settings)),
    )
    done = sldvexp("rerun", str(point))
    assert done.status == 1
    assert "was measured, and its scan lines are not beside it in journal" in done.err


@pytest.mark.parametrize("words", [[], ["a", "b"], ["nothing.nc"], ["mine.csv"], ["swept"]])
def test_what_is_no_run(words, sldvexp, tmp_path):
    (tmp_path / "mine.csv").write_text("1")
    (tmp_path / "swept/seed=1").mkdir(parents=True)
    (tmp_path / "swept/seed=1/run.nc").touch()
    done = sldvexp("rerun", *words)
    assert done.status == 1
    assert len(done.err.splitlines()) == 1
    assert ("is a sweep; rerun takes one of its runs" in done.err) == (words == ["swept"])


def test_agreement_of_single_quantities():
    def tree(**arrays):
        return xr.DataTree.from_dict({"/g": xr.Dataset({k: ("x", v) for k, v in arrays.items()})})

    nan = np.nan
    before = tree(same=[1.0, nan], close=[1.0, nan], far=[1.0, 2.0], gone=[0.0, 0.0], hole=[1.0, 2])
    after = tree(same=[1.0, nan], close=[1 + 1e-12, nan], far=[1.0, 2.1], hole=[1.0, nan])
    found = {d.name: d.kind for d in compare(before, after)}
    assert found == {
        "g/same": AgreementLevel.identical,
        "g/close": AgreementLevel.rounding,
        "g/far": AgreementLevel.different,
        "g/gone": AgreementLevel.different,
        "g/hole": AgreementLevel.different,
    }
