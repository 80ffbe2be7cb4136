"""Libraries put no docstrings together in a command's process, and work as ever."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import sys
from sldvexp import lazy

lazy.OF_DOCSTRINGS["colorsys"] = lambda module: module.another_release
if sys.argv.pop(1) == "command":
    from sldvexp.cli import command
    try:
        command.main([])
    except SystemExit:
        pass

import colorsys
import inspect
import scipy.fft
from matplotlib.lines import Line2D

line = Line2D([0, 1], [0, 1])
line.set(lw=3)
assert line.get_linewidth() == 3 and "linewidth" in inspect.signature(line.set).parameters
assert scipy.fft.fft([1.0, 1.0]).tolist() == [2.0, 0.0]
assert colorsys.rgb_to_hsv(0, 0, 0)[2] == 0
print("Parameters" in scipy.fft.fft.__doc__, "agg_filter" in Line2D.set.__doc__)
"""


def _told(who: str) -> str:
    call = [sys.executable, "-c", PROGRAM, who, "--version"]
    return subprocess.run(call, capture_output=True, text=True, check=True).stdout.splitlines()[-1]


def test_a_command_puts_no_docstrings_together():
    assert _told("command") == "False False"


def test_who_imports_the_program_has_them():
    assert _told("notebook") == "True True"
