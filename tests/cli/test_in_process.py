"""Runs from Python: the same results and the same sentences as the command's."""

from __future__ import annotations

import logging
import pydoc
import sys

import numpy as np
import pytest

import sldvexp as package
from sldvexp.cli.in_process import watched_run
from sldvexp.errors import UserError
from sldvexp.instrument import InstrumentError
from sldvexp.session import Operator, Watcher, Wish


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_result_is_that_of_the_command(sldvexp, here):
    done = sldvexp("experiment=point")
    found = package.run("experiment=point")
    assert done.status == 0
    assert found.groups == done.tree.groups
    for node in done.tree.subtree:
        for name, values in node.data_vars.items():
            np.testing.assert_array_equal(found[node.path][name], values, err_msg=name)
    assert (here / "outputs").is_dir()
    assert found.encoding["source"].endswith("/run.nc")
    assert package.open_run(found.encoding["source"]).groups == found.groups


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "settings",
    [
        ["experiment=nope"],
        ["experiment=point", "seed=-1"],
        ["experiment=pose", "pose.pathh=x"],
        ["experiment=pose", "pose.path=nope.reg"],
        ["experiment=pose", "laser.mirror_offset=x"],
        ["~experiment"],
    ],
)
def test_mistakes_have_the_sentence_of_the_command(sldvexp, here, settings):
    with pytest.raises(UserError) as mistake:
        package.run(*settings)
    done = sldvexp(*settings)
    assert done.status == 1
    told = "".join(f"sldvexp: {line}\n" for line in str(mistake.value).splitlines())
    assert told == done.err


@pytest.mark.parametrize("word", ["-m", "list", "--cfg", "plate", 3])
def test_only_settings_are_taken(here, word):
    with pytest.raises(UserError, match="is no setting"):
        package.run("experiment=point", word)
    assert list(here.iterdir()) == []


@pytest.mark.whole
def test_folders_of_ones_own(here):
    (here / "lab" / "experiment").mkdir(parents=True)
    (here / "lab" / "experiment" / "mine.yaml").write_text(
        "# @package _global_\ndefaults: [point]\nseed: 77\n"
    )
    assert package.run("experiment=mine", config_dir=here / "lab").attrs["seed"] == 77


def test_a_program_around_it_stays_as_it_was(here):
    logger, argv = logging.getLogger(), list(sys.argv)
    handler = logging.NullHandler()
    logger.addHandler(handler)
    try:
        before = (list(logger.handlers), logger.level)
        package.run("experiment=point")
        assert (list(logger.handlers), logger.level) == before
        assert sys.argv == argv
    finally:
        logger.removeHandler(handler)


def test_help_reads_as_a_page():
    page = pydoc.plain(pydoc.render_doc(package))
    for word in ("sldvexp.run(", "open_run", "reconstruction", "sldvexp handbook"):
        assert word in page
    assert package.__version__
    assert set(dir(package)) >= {"run", "open_run", "pose", "field", "reconstruction", "plot"}


def test_the_package_itself_is_light(loaded_by):
    assert loaded_by("import sldvexp; dir(sldvexp); sldvexp.pose")[0] == ""


def test_one_run_and_no_sweep(here):
    with pytest.raises(UserError, match="does one run; a sweep is for the command"):
        package.run("experiment=point", "hydra.mode=MULTIRUN", "seed=1,2")
    with pytest.raises(UserError, match="is no setting"):
        package.run(f"resume={here}")


def test_a_configuration_is_checked_once(here, monkeypatch):
    from sldvexp.config import schema

    build, built = schema.build, []
    monkeypatch.setattr(schema, "build", lambda cfg: built.append(cfg) or build(cfg))
    package.run("experiment=point", quiet=True)
    assert len(built) == 1


class Fed(Watcher):
    """Somebody who has enough after so many lines."""

    def __init__(self, lines):
        self.left = lines

    def between_lines(self, view, lines, done, count):
        if not self.left:
            raise UserError("enough")
        self.left -= 1
        return Wish()


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("lines", "kept"), [(2, True), (0, False)])
def test_a_scan_that_ends_early_says_how_it_goes_on_if_anything_is_kept(here, lines, kept):
    with pytest.raises(UserError, match="enough") as error:
        watched_run(["experiment=plate"], "none", Fed(lines), Operator())
    told = f"; what was scanned is kept, go on with: sldvexp resume={here}/outputs/"
    assert (told in str(error.value)) == kept


class Broken(Fed):
    """Whose instrument fails after so many lines."""

    def between_lines(self, view, lines, done, count):
        if not self.left:
            raise InstrumentError("it is lost")
        return super().between_lines(view, lines, done, count)


def test_an_instrument_that_fails_says_once_how_the_scan_goes_on(here):
    with pytest.raises(UserError, match="it is lost") as error:
        watched_run(["experiment=plate"], "none", Broken(2), Operator())
    assert str(error.value).count("resume=") == 1
