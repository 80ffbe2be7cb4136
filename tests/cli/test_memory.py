"""Memory of a run's process is that of one heap, and at its end nobody looks for garbage in it."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

#: Allocates in several threads at once, and lets the C library tell of its heaps.
PROGRAM = """
import ctypes, sys, threading
from sldvexp.cli import command

if sys.argv[1] == "one":
    command._share_one_heap()
all_there = threading.Barrier(4)

def work():
    all_there.wait()
    kept = [bytearray(5000) for _ in range(50)]
    all_there.wait()
    return kept

threads = [threading.Thread(target=work) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
library = ctypes.CDLL(None)
library.fdopen.restype = ctypes.c_void_p
out = ctypes.c_void_p(library.fdopen(1, b"w"))
library.malloc_info(0, out)
library.fflush(out)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of GNU's C library")
@pytest.mark.one_in(2)
@pytest.mark.parametrize("heaps", ["one", "many"])
def test_threads_share_one_heap(heaps):
    call = [sys.executable, "-c", PROGRAM, heaps]
    told = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert (told.count("<heap nr=") == 1) == (heaps == "one")


#: Tells at the very end how many objects the search for garbage passes over.
ENDING = """
import atexit, gc
atexit.register(lambda: print(gc.get_freeze_count(), len(gc.get_objects())))
from sldvexp.cli import command
command.main([])
"""


def test_a_process_that_ends_looks_for_no_garbage():
    call = [sys.executable, "-c", ENDING, "--version"]
    told = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    passed_over, others = map(int, told.splitlines()[-1].split())
    assert others < 1000 < passed_over
