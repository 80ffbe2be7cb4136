"""A user's own folder of configuration files: experiments, choices of groups, and new groups."""

from __future__ import annotations

import pytest
import yaml

from sldvexp import dataset
from sldvexp.config.paths import conf_dir

MARKS = "fiducials: {1: {x: 0, y: 0}, 2: {x: 1, y: 0}, 3: {x: 0, y: 1}}\n"
FILES = {
    "experiment/may/monday.yaml": """# @package _global_
# What was measured on Monday.
defaults:
  - /mirror@laser.up_down: worn
  - _self_
  - override /target: bench
  - override /laser: ours
seed: 5
""",
    "target/bench.yaml": f"defaults: [schema/points@_here_, _self_]\nunit: cm\n{MARKS}",
    "laser/ours.yaml": "# The lab's own.\ndefaults: [ometron, _self_]\nmirror_offset: 0.045\n",
    "laser/ometron.yaml": """# Ours too.
defaults: [schema/two_mirror@_here_, _self_]
board: bits_16
""",
    "mirror/worn.yaml": "gain: 24.0\n",
}
MONDAY = ("--config-dir", "lab", "experiment=may/monday")


@pytest.fixture
def lab(tmp_path):
    """The user's folder."""
    for name, text in FILES.items():
        file = tmp_path / "lab" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return tmp_path / "lab"


@pytest.fixture(autouse=True)
def one_composition(monkeypatch):
    """Hydra composes twice, first only for `hydra.mode`, which nothing here sets: half the time."""
    monkeypatch.setattr("hydra._internal.hydra.Hydra.get_mode", lambda *_, **__: None)


@pytest.mark.whole
def test_own_experiment_with_own_choices_runs(sldvexp, lab, tmp_path):
    done = sldvexp("-m", *MONDAY, "laser=ours,ometron_16bit", "hydra.sweep.dir=sweep")
    assert done.status == 0, done.err
    files = sorted((tmp_path / "sweep").glob("*/run.nc"))
    assert len(files) == 2
    for file in files:
        with dataset.load(file) as tree:
            assert tree.attrs["seed"] == 5
            assert tree["target/position"].max() == 0.01  # 1 cm


def test_own_files_are_merged_in_their_order(sldvexp, lab):
    out = sldvexp(*MONDAY, "--cfg", "job", "--package", "laser").out
    assert "mirror_offset: 0.045\n" in out  # from ours, which includes the user's ometron,
    assert "board: bits_16\n" in out  # which wins over the program's
    assert "up_down:\n  gain: 24.0\n" in out  # from worn


def test_own_choices_are_listed_and_shown(sldvexp, lab):
    assert "may/monday" in sldvexp("list", "--config-dir", "lab", "experiment").out
    lasers = " ".join(sldvexp("list", "laser", "--config-dir", "lab").out.split())
    assert "; laser=ometron, laser=ometron_16bit, laser=ours" in lasers
    assert "target=bench" in sldvexp("--config-dir", "lab", "list", "target").out
    out = sldvexp("show", "--config-dir", "lab", "laser=ours").out
    assert "file    lab/laser/ours.yaml: The lab's own\n" in out
    assert "  mirror_offset: 0.045\n" in out
    out = sldvexp("show", "--config-dir", "lab", "experiment=may/monday").out
    assert "\nWhat was measured on Monday.\n" in out
    assert "  target=bench\n  laser=ours\n" in out
    assert "lab/experiment/may/monday.yaml sets\n  seed: 5\n" in out
    out = sldvexp("--config-dir", "lab", "--help").out
    assert "bench, dissertation" in out
    assert "ometron, ours, ometron_16bit" in out


@pytest.mark.one_in(8)
@pytest.mark.parametrize(
    ("file", "old", "new", "told"),
    [
        ("target/bench.yaml", "unit", "unti", "target.unti is not a known setting; did you mean"),
        ("target/bench.yaml", "unit: cm", "unit: mile", "target.unit cannot be mile; Valid: "),
        ("target/bench.yaml", "x: 1", "x: .nan", "target.fiducials.2 must be finite, not nan"),
        ("target/bench.yaml", "schema/points", "schema/pionts", "there is no target/schema=pionts"),
        ("laser/ours.yaml", "[ometron", "[ometrom", "there is no laser=ometrom; did you mean"),
        ("laser/ours.yaml", "[ometron", "[{a: 1, b: 2}", "its defaults must be a list of names"),
        ("mirror/worn.yaml", "gain", "gian", "laser.up_down.gian is not a known setting"),
        ("mirror/worn.yaml", "24.0", "0.0", "laser.up_down.gain must not be zero"),
        ("mirror/worn.yaml", "gain: 24.0", "_target_: os.system", "laser.up_down._target_ is refu"),
        ("experiment/may/monday.yaml", "/laser", "/lazer", "its defaults override lazer, which"),
        ("experiment/may/monday.yaml", ": bench", ": bensh", "there is no target=bensh; did you"),
        ("experiment/may/monday.yaml", "seed: 5", "seed: [", "line 9: is not YAML: "),
        ("experiment/may/monday.yaml", "# @package _global_", "", "must begin with the line"),
        (
            "experiment/may/monday.yaml",
            "override /laser: ours",
            "/mirror@laser.left_right: worn",
            "its defaults have mirror@laser.left_right after an override, but overrides must",
        ),
    ],
)
def test_mistake_is_told_with_the_users_file(sldvexp, lab, file, old, new, told):
    text = FILES[file]
    assert old in text
    (lab / file).write_text(text.replace(old, new))
    done = sldvexp(*MONDAY)
    assert done.status == 1
    assert done.err.startswith((f"sldvexp: lab/{file}: {told}", f"sldvexp: lab/{file}, {told}"))
    assert done.err.count("\n") == 1


def test_file_of_a_folder_elsewhere_is_told_with_its_whole_path(
    sldvexp, lab, tmp_path, monkeypatch
):
    (lab / "mirror/worn.yaml").write_text("gian: 24.0\n")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    done = sldvexp("--config-dir", "../lab", "experiment=may/monday")
    assert done.err.startswith(f"sldvexp: {lab}/mirror/worn.yaml: laser.up_down.gian is not a kno")


@pytest.mark.whole
@pytest.mark.parametrize("name", ["spoiled/sign", "/experiment/spoiled/sign"])
@pytest.mark.parametrize("mine", ["mine", "may/mine"])
def test_own_experiment_extends_one_of_the_programs(sldvexp, lab, name, mine):
    (lab / "experiment" / f"{mine}.yaml").write_text(
        f"# @package _global_\ndefaults: [{name}, _self_]\nseed: 5\n"
    )
    done = sldvexp("--config-dir", "lab", f"experiment={mine}", "--cfg", "job")
    assert done.status == 0, done.err
    assert "      sign: -1" in done.out
    assert "seed: 5\n" in done.out


@pytest.mark.whole
def test_an_own_configuration_chooses_an_experiment_of_the_programs(sldvexp, lab):
    (lab / "mine.yaml").write_text(
        "defaults: [config, override experiment: spoiled/sign, _self_]\nseed: 5\n"
    )
    done = sldvexp("--config-dir", "lab", "--config-name", "mine", "--cfg", "job")
    assert done.status == 0, done.err
    assert "      sign: -1" in done.out


def test_experiments_extend_one_another_by_names_that_hold_from_everywhere():
    for file in (conf_dir() / "experiment").rglob("*.yaml"):
        included = yaml.safe_load(file.read_text()).get("defaults", [])
        relative = [d for d in included if isinstance(d, str) and d != "_self_" and d[0] != "/"]
        assert not relative, f"{file}: write /experiment/{relative[0]}"
