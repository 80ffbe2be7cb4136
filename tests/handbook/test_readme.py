"""The README: why, two commands, a first own run that works, and links that lead on."""

from __future__ import annotations

import re
from pathlib import Path

from sldvexp.config.paths import HANDBOOK

ROOT = HANDBOOK.parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def test_readme_is_short_and_has_the_two_commands():
    assert len(README.splitlines()) <= 200
    assert BLOCKS[0] == "python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/sldvexp\n"
    assert BLOCKS[1] == (
        "python3 -m venv .venv && .venv/bin/pip install -e '.[test]' && .venv/bin/pytest\n"
    )


def test_first_own_run_works_as_it_stands(sldvexp):
    table, command = BLOCKS[2:4]
    Path("velocities.csv").write_text(table, encoding="utf-8")
    program, *words = command.split()
    done = sldvexp(*words)
    assert (program, done.status) == ("sldvexp", 0)
    assert "verdict: trusted" in done.out
    assert "found: velocity at 450 Hz: x " in done.out


def test_links_lead_somewhere_and_to_every_page():
    files = [file for _, file in re.findall(r"\[([^]]*)\]\(([^)]+)\)", README)]
    assert len(files) > 20
    for file in files:
        assert (ROOT / file).is_file(), file
    linked = {Path(file).stem for file in files if file.startswith("sldvexp/handbook/")}
    assert {page.stem for page in HANDBOOK.glob("*.md")} - linked <= {"viewer"}
