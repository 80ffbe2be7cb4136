"""Memory that parts of a field have one after the other."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource
import numpy as np
from sldvexp.field.memory import kept_memory

def pages():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [np.ones(2**17) for _ in range(100)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

first = pages()
with kept_memory():
    pages()
    kept = pages()
print(first, kept, pages())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of the C library of Linux")
def test_memory_is_kept_for_the_next_part_and_given_back() -> None:
    made = subprocess.run(
        [sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True
    )
    first, kept, after = map(int, made.stdout.split())
    assert kept < first / 20  # of a megabyte 256 pages otherwise
    assert after > first / 2
