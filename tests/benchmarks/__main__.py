"""All benchmarks in one table: ``python tests/benchmarks``, further words as pytest takes them.

One thread of linear algebra has to be asked for before numpy is loaded.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

THREADS = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")

if __name__ == "__main__":
    call = [sys.executable, "-m", "pytest", "-n0", "-q", "-m", "", str(Path(__file__).parent)]
    environment = {**os.environ, **THREADS, "SLDVEXP_BENCHMARK": "1"}
    sys.exit(subprocess.run([*call, *sys.argv[1:]], env=environment, check=False).returncode)
