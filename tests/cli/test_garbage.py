"""Whatever is typed, the command answers in sentences: never with a traceback."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

KEYS = (
    *("seed", "target", "laser", "pose", "instrument", "check", "compare", "expect", "experiment"),
    *("laser.mirror_offset", "laser.board", "laser.up_down", "laser.up_down.polynomial"),
    *("pose.path", "pose.adjust", "pose.adjust.mirror_offset", "pose.inverted", "pose.unit"),
    *("pose.confidence", "pose.max_iterations", "check.a", "check.a.plugin", "compare.a.rows"),
    *("expect.a", "expect.a.at_most", "target@laser", "pose@check.a", "hydra", "hydra.job"),
)
VALUES = (
    *("", "null", "nan", "-inf", "1e999", "true", "???", "[]", "{}", "[1,[2]]", "{a: {b: 1}}"),
    *("${seed}", "${nope}", "${nope:1}", "'${'", "\\", "1,2", "range(1,3)", "glob(*)", "{1: 2}"),
    *("{plugin: printed}", "{plugin: 3}", "_target_", "{_target_: os.abort}", "a:b", '"', "'"),
    *("../..", "conf://", ".", "\N{SNOWMAN}", "{at_most: {pose/sse: x}}", "[up_down,up_down]"),
)
keys = st.sampled_from(KEYS) | st.text(max_size=8).filter(lambda key: not key.startswith("-"))
values = st.sampled_from(VALUES) | st.text(max_size=8)
words = st.builds("{}{}={}".format, st.sampled_from(["", "", "", "+", "++", "~"]), keys, values)


@pytest.mark.whole
@pytest.mark.filterwarnings("error::RuntimeWarning")
@settings(
    max_examples=50,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(typed=st.lists(words, min_size=1, max_size=2))
def test_garbage_gets_sentences(typed, sldvexp, monkeypatch):
    monkeypatch.setattr("hydra._internal.hydra.Hydra.get_mode", lambda *_, **__: None)
    done = sldvexp("~experiment", "pose=registration", "pose.path=none.reg", *typed)
    assert done.status in (0, 1, 2)
    said = done.err.splitlines()
    assert done.status != 1 or said
    assert all(line.startswith("sldvexp: ") for line in said), done.err
