"""Bad inputs, each through the real command: exit status 1, one sentence, nothing left behind.

A sentence says what is wrong, where, and what would be right.
"""

from __future__ import annotations

import shlex

import pytest

from tests.cli.bad_files import BAD_FILES
from tests.cli.bad_settings import BAD_SETTINGS


@pytest.fixture(autouse=True)
def one_composition(monkeypatch):
    """Hydra composes twice, first only for `hydra.mode`, which nothing here sets: half the time."""
    monkeypatch.setattr("hydra._internal.hydra.Hydra.get_mode", lambda *_, **__: None)


def test_there_are_enough():
    assert len({bad.answer for bad in [*BAD_SETTINGS, *BAD_FILES]}) >= 60


@pytest.mark.one_in(18)
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("bad", [*BAD_SETTINGS, *BAD_FILES], ids=lambda bad: bad.arguments)
def test_bad_input_gets_one_sentence(bad, sldvexp, tmp_path):
    bad.write_files(tmp_path)
    done = sldvexp(*shlex.split(bad.arguments))
    assert bad.answered_by(done.err, tmp_path), done.err
    assert done.status == 1
    assert "Traceback" not in done.out + done.err
    assert list(tmp_path.rglob("run.nc")) == []
    assert not (tmp_path / "ran").exists()
