"""`sldvexp show` of what is no finished run: one that failed or was cut off, and sweeps."""

from __future__ import annotations

from pathlib import Path

import pytest

from sldvexp.session.journal import lines_kept


def test_run_that_failed_says_why_what_it_has_and_how_it_goes_on(sldvexp):
    failed = sldvexp(
        "experiment=plate",
        "instrument=visa",
        "instrument.resource=TCPIP::127.0.0.1::9::SOCKET",
        "instrument.retries=0",
    )
    assert "cannot be reached" in failed.err
    (failed.folder / "journal" / "1").mkdir(parents=True)
    (failed.folder / "journal" / "1" / "1_coarse_000.npz").touch()
    told = sldvexp("show", str(failed.folder))
    assert (told.status, told.err) == (0, "")
    lines = told.out.replace("\n    ", " ").splitlines()
    assert [line.partition(":")[0] for line in lines] == [
        "not finished",
        "scanned",
        "files",
        "next",
    ]
    assert "127.0.0.1::9::SOCKET cannot be reached" in lines[0]
    assert lines[1] == "scanned: 1 lines of view 1"
    assert "report.html" in lines[2]
    assert lines[3].startswith(f"next: sldvexp resume={failed.folder} goes on; or open ")


def test_run_without_a_last_word_was_cut_off(sldvexp, tmp_path):
    (tmp_path / "cut" / ".hydra").mkdir(parents=True)
    told = sldvexp("show", "cut")
    assert told.out.startswith("not finished: the run was cut off, or is still at work\n")
    assert "scanned: nothing" in told.out


def test_sweep_shows_the_table_of_its_runs(sldvexp):
    swept = sldvexp("-m", "experiment=point", "seed=1,2", "hydra.sweep.dir=out/swept")
    table = swept.out[swept.out.index("2 runs by") :].splitlines()
    for given in ("out/swept", "out/swept/sweep.nc"):
        told = sldvexp("show", given)
        assert (told.status, told.err) == (0, "")
        assert told.out.splitlines()[: len(table) - 3] == table[: len(table) - 3]
        assert "out/swept/sweep.csv" in told.out
    Path("out/swept/sweep.nc").unlink()  # as of a sweep that is cut off, or still at work
    told = sldvexp("show", "out/swept")
    assert told.status == 0, told.err
    assert "2 runs by" in told.out


@pytest.mark.parametrize("name", ["", "nothing.nc"])
def test_folder_of_neither_is_refused_in_a_sentence(sldvexp, tmp_path, name):
    (tmp_path / "x").mkdir()
    done = sldvexp("show", f"{tmp_path}/x/{name}")
    assert (done.status, done.err.count("\n")) == (1, 1)
    assert "has no run.nc; give a run, a sweep, or the folder of one" in done.err


def test_hidden_files_of_a_journal_are_no_lines(tmp_path):
    (tmp_path / "a").mkdir()
    for name in ("image_000.npz", ".image_001.npz", "left.json"):
        (tmp_path / "a" / name).touch()
    assert lines_kept(tmp_path) == {"a": 1}
