"""Large universal files: the index, one function of many, memory, and all of it against pyuff.

Figures are asserted at full size only, with ``SLDVEXP_BENCHMARK=1``; otherwise a small file is
checked for the same numbers.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from sldvexp.io.uff import universal_file

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
FUNCTIONS, VALUES = (10_000, 12_500) if FULL_SIZE else (50, 100)
#: Of these, pyuff reads as many as make 200 MB.
COMPARED = 2000 if FULL_SIZE else 50
#: The shortest of each counts, the one that others disturbed least.
ROUNDS = 3 if FULL_SIZE else 1
SECONDS_OF_INDEX = 2.0
SECONDS_OF_ONE = 0.1
FASTER_THAN_PYUFF = 5.0
MOST_MEMORY = 300 << 20

#: Run in a process of its own, whose memory is that of reading alone.
INDEX_AND_ONE = """
import json, sys, time
from pathlib import Path
from sldvexp.io.uff import universal_file

index, one = [], []
for _ in range(int(sys.argv[3])):
    begin = time.perf_counter()
    with universal_file(Path(sys.argv[1])) as file:
        count = len(file.functions)
        indexed = time.perf_counter()
        _, values = file.values(file.functions[int(sys.argv[2])])
        read = time.perf_counter()
    index.append(indexed - begin)
    one.append(read - indexed)
# Not ru_maxrss, which a process begins with that of its parent.
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(json.dumps({
    "count": count,
    "index": min(index),
    "one": min(one),
    "sum": abs(values).sum(),
    "memory": 1024 * int(peak.split()[1]),
}))
"""


def written(path: Path, functions: int) -> Path:
    """A file of 58b with complex single values; function k has the values k + 1j ..."""
    values = (np.arange(VALUES) * (1 - 0.5j)).astype("<c8")
    with path.open("wb") as file:
        for k in range(functions):
            raw = (values + np.complex64(k)).tobytes()
            file.write(b"    -1\n    58b     1     2          11%12d" % len(raw))
            file.write(b"     0     0           0           0\n" + b"made" + b" " * 76 + b"\n")
            file.write(b"NONE\n" * 4)
            file.write(b"    4         1    0         0 NONE      %10d   3" % (k + 1))
            file.write(b" NONE               1   3\n")
            file.write(b"         5%10d         1" % VALUES)
            file.write(b"  0.00000E+00  1.00000E+00  0.00000E+00\n")
            for kind in (18, 11, 13, 0):
                file.write(b"%10d    0    0    0 NONE                 NONE\n" % kind)
            file.write(raw + b"    -1\n")
    return path


@pytest.fixture(scope="module")
def large(tmp_path_factory) -> Path:
    return written(tmp_path_factory.mktemp("uff") / "large.uff", FUNCTIONS)


def test_index_and_one_function(large):
    which = FUNCTIONS * 3 // 4
    command = [sys.executable, "-c", INDEX_AND_ONE, str(large), str(which), str(ROUNDS)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    print(f"{large.stat().st_size / 1e9:.2f} GB: {found}")
    assert found["count"] == FUNCTIONS
    expected = np.abs((np.arange(VALUES) * (1 - 0.5j)).astype("c8") + np.complex64(which))
    assert found["sum"] == pytest.approx(expected.astype(float).sum(), rel=1e-6)
    assert found["memory"] < MOST_MEMORY
    if FULL_SIZE:
        assert found["index"] < SECONDS_OF_INDEX
        assert found["one"] < SECONDS_OF_ONE


def test_all_functions_against_pyuff(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    path = written(tmp_path / "compared.uff", COMPARED)

    def read():
        with universal_file(path) as file:
            return [file.values(f) for f in file.functions]

    shortest = {"own": np.inf, "pyuff": np.inf}
    for _ in range(ROUNDS):
        for name, work in (("own", read), ("pyuff", lambda: pyuff.UFF(str(path)).read_sets())):
            begin = time.perf_counter()
            found = work()
            shortest[name] = min(shortest[name], time.perf_counter() - begin)
            if name == "own":
                own = found
    theirs = found
    seconds, seconds_of_pyuff = shortest["own"], shortest["pyuff"]

    assert len(own) == len(theirs) == COMPARED
    for (x, y), other in zip(own, theirs, strict=True):
        np.testing.assert_array_equal(x, other["x"])
        np.testing.assert_array_equal(y, other["data"])
    print(f"{seconds:.3f} s, pyuff {seconds_of_pyuff:.3f} s: {seconds_of_pyuff / seconds:.1f}")
    if FULL_SIZE:
        assert seconds_of_pyuff > FASTER_THAN_PYUFF * seconds
