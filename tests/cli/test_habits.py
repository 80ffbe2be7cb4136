"""What people do who know Hydra, or who do not: it works, or a sentence says what to write."""

from __future__ import annotations

import pytest

from sldvexp.config.sources import Origins

CORNERS = "{corners: [[-640, 140], [-640, -1440], [640, -1440], [640, 140]]}"
SCAN = f"""# @package _global_
defaults:
  - _self_
  - override /scene: plate
  - override /scan: rectangle
  - override /instrument: simulated
  - override /signal: sine_fit
scan:
  views:
    NAME: {CORNERS}
  pixels: [4, 4]
"""
POSE = "# @package _global_\ndefaults:\n  - override /pose: registration\n  - _self_\n"
QUICK = ("~experiment", "target=dissertation", "report=none")


@pytest.fixture
def lab(tmp_path):
    """The user's folder; give names of experiments and their text."""

    def write(**files):
        for name, text in files.items():
            file = tmp_path / "my/experiment" / name.replace("_yml", ".yml")
            file = file if file.suffix else file.with_suffix(".yaml")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(text if isinstance(text, bytes) else text.encode())

    return write


@pytest.mark.one_in(5)
@pytest.mark.parametrize(
    "line",
    [
        ["seed=1,2", "-m", *QUICK],
        ["-m", *QUICK, "seed=1,2"],
        [*QUICK, "--multirun", "seed=1,2"],
        [*QUICK, "seed=1,2", "hydra.mode=MULTIRUN"],
        ["hydra.mode=MULTIRUN", "seed=1,2", *QUICK],
    ],
)
def test_sweep_may_be_asked_for_anywhere(sldvexp, tmp_path, line):
    done = sldvexp(*line, "hydra.sweep.dir=swept")
    assert done.status == 0, done.err
    assert (tmp_path / "swept/sweep.nc").is_file()
    assert len(list((tmp_path / "swept").glob("*/run.nc"))) == 2


@pytest.mark.whole
def test_file_may_ask_for_a_sweep(sldvexp, lab, tmp_path):
    lab(
        x=POSE
        + "pose: {path: conf://data/figure_4_28.csv}\nreport: null\nhydra: {mode: MULTIRUN}\n"
    )
    done = sldvexp("--config-dir", "my", "experiment=x", "seed=1,2", "hydra.sweep.dir=swept")
    assert done.status == 0, done.err
    assert (tmp_path / "swept/sweep.nc").is_file()


@pytest.mark.one_in(5)
@pytest.mark.parametrize(
    "line",
    [
        ["experiment=x", "--config-dir", "my", "seed=4"],
        ["experiment=x", "--config-dir=my", "seed=4"],
        ["seed=4", "-cd", "my", "experiment=x"],
        ["--config-d", "my", "experiment=x", "seed=4"],
        ["seed=4", "--cfg", "job", "experiment=x", "--config-dir", "my"],
    ],
)
def test_folder_of_configurations_may_be_named_anywhere(sldvexp, lab, line):
    lab(x=POSE + "pose: {path: conf://data/figure_4_28.csv}\n")
    assert "seed: 4\n" in sldvexp(*line, "--cfg", "job").out


def test_a_recording_is_played_in_the_place_of_the_instrument_that_a_file_sets(sldvexp, lab):
    visa = SCAN.replace("NAME", "1").replace("instrument: simulated", "instrument: visa")
    lab(x=f"{visa}instrument: {{resource: TCPIP::192.0.2.1::5025::SOCKET, timeout: 5.0}}\n")
    line = ("--config-dir", "my", "experiment=x", "--cfg", "job", "-p", "instrument")
    done = sldvexp(*line, "instrument=replay", "instrument.path=outputs/before")
    assert (done.status, done.err) == (0, "")
    assert "path: outputs/before\n" in done.out
    assert "resource" not in done.out
    lab(y="# @package _global_\ndefaults: [x, _self_]\ninstrument: {timout: 5.0}\n")
    wrong = sldvexp("--config-dir", "my", "experiment=y", "--cfg", "job")
    assert "instrument.timout is not a known setting; did you mean timeout?" in wrong.err


@pytest.mark.whole
@pytest.mark.parametrize("name", ["1", "'1'", '"1"'])
def test_view_has_the_same_name_with_quotes_and_without(sldvexp, lab, name):
    lab(x=SCAN.replace("NAME", name))
    done = sldvexp("--config-dir", "my", "experiment=x", "--cfg", "job", "-p", "scan")
    assert "  '1':\n" in done.out, done.err
    lab(
        y="# @package _global_\n# One of curved_panel changed.\ndefaults: [curved_panel, _self_]\n"
        f"scan: {{views: {{{name}: {CORNERS}}}}}\n"
    )
    out = sldvexp("--config-dir", "my", "experiment=y", "--cfg", "job", "-p", "scan.views").out
    assert out.count("'1':\n") == 1
    assert "- -640" in out
    assert "'2':\n" in out
    table = f"scan.views={{{name}: {CORNERS}}}"
    for line in (table, f"scan={{views: {{{name}: {CORNERS}}}}}"):
        shown = sldvexp("experiment=curved_panel", line, "--cfg", "job", "-p", "scan.views").out
        assert shown == out


def test_fiducial_marks_keep_their_numbers(sldvexp):
    marks = "{1: {x: 0, y: 0}, 2: {x: 1, y: 0}, 3: {x: 0, y: 1}}"
    fiducials = ("~experiment", "target=fiducials", f"target.fiducials={marks}")
    out = sldvexp(*fiducials, "--cfg", "job", "-p", "target.fiducials").out
    assert "\n1:\n" in out
    assert "\n3:\n" in out


@pytest.mark.parametrize(
    ("files", "chosen", "told"),
    [
        (
            {"x_yml": POSE},
            "experiment=x",
            "my/experiment/x.yml: has the ending .yml, and configurations end with .yaml",
        ),
        (
            {"x_yml": POSE},
            "experiment=x.yml",
            "my/experiment/x.yml: has the ending .yml, and configurations end with .yaml",
        ),
        (
            {"x": POSE.replace("override /", "")},
            "experiment=x",
            "my/experiment/x.yaml: its defaults choose pose: registration below experiment; the "
            "item must be 'override /pose: registration'",
        ),
        (
            {"x": POSE.replace("override ", "")},
            "experiment=x",
            "my/experiment/x.yaml: two files choose pose; in the defaults of the second the item "
            "must be 'override /pose: name'",
        ),
    ],
)
@pytest.mark.parametrize(
    "beside", [{}, {"bad": "a: [", "worse": b"\xff\xfe", "worst": "defaults: 3"}]
)
def test_mistake_is_told_with_its_file_whatever_lies_beside(
    sldvexp, lab, files, chosen, told, beside
):
    lab(**files, **beside)
    done = sldvexp("--config-dir", "my", chosen)
    assert (done.status, done.err) == (1, f"sldvexp: {told}\n")


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("seed=x", "command line: seed must be a whole number, not x"),
        ("pose=nope", "command line: there is no pose=nope; Valid: "),
        ("experiment=nope", "command line: there is no experiment=nope; "),
        ("pose.nope=1", "command line: pose.nope is not a known setting; "),
    ],
)
def test_bad_file_beside_is_not_blamed(sldvexp, lab, setting, told):
    lab(bad="a: [", worse=b"\xff\xfe", worst="defaults: 3", laughing="a: &a [*a]")
    done = sldvexp("--config-dir", "my", *["experiment=pose"] * ("experi" not in setting), setting)
    assert done.err.startswith(f"sldvexp: {told}"), done.err
    assert done.err.count("\n") == 1


def test_bad_file_is_one_line_of_a_check(sldvexp, lab):
    lab(bad="a: [", good=POSE + "pose: {path: conf://data/figure_4_28.csv}\n")
    done = sldvexp("check", "my")
    assert done.status == 2
    assert "FAILED  experiment=bad: my/experiment/bad.yaml, line " in done.out
    assert "passed  experiment=good: " in done.out


@pytest.mark.whole
def test_run_says_which_views_come_from_the_example(sldvexp, lab):
    place = "{euler: [0.024, 2.910, -3.117], origin: [0.290, 0.530, 1.655]}"
    lab(x=SCAN.replace("NAME", "a") + f"scene: {{views: {{a: {place}}}}}\n")
    done = sldvexp("--config-dir", "my", "experiment=x", "report=none")
    assert done.status == 0, done.err
    told = (
        "scene.views: 1, 2, 3, 4, 5 come from conf/scene/plate.yaml, beside a of yours; "
        "~scene.views.1 leaves one out"
    )
    assert f"sldvexp: warning: {told}\n" in done.err
    (log,) = done.folder.parent.rglob("sldvexp.log")
    assert told in log.read_text()
    assert "scene.plate.modes" not in done.err  # of which nothing is the user's


@pytest.mark.whole
def test_entry_of_the_example_that_is_changed_is_no_mixture(sldvexp, lab):
    place = "{euler: [0.024, 2.910, -3.117], origin: [0.290, 0.530, 1.655]}"
    lab(x=SCAN.replace("NAME", '"1"') + f"scene: {{views: {{1: {place}}}}}\n")
    done = sldvexp("--config-dir", "my", "experiment=x", "report=none")
    assert (done.status, done.err) == (0, "")


def test_files_are_composed_once_where_no_table_is_given(sldvexp, monkeypatch):
    composed = []
    monkeypatch.setattr(Origins, "layers_of_files", lambda self: composed.append(self) or [])
    assert sldvexp("experiment=point", "report=none", "seed=3").status == 0
    assert composed == []
