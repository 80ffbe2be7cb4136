"""The `sldvexp` command. It imports nothing heavy: help, completion and `--cfg` answer at once."""

from __future__ import annotations

import logging
import os
import sys

import hydra
from omegaconf import DictConfig

from sldvexp import complaints, registry
from sldvexp.paths import conf_dir

FAILED, MISSED, INTERRUPTED = 1, 2, 130


def main() -> None:
    """Compose the configuration, run it, and turn a user's mistake into one sentence.

    Exit status: 0 done, 1 not done (one sentence on standard error), 2 done but an expectation
    was missed, 130 interrupted.
    """
    full_error = os.environ.get("HYDRA_FULL_ERROR") == "1"
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises, and we choose the words
    missed = False

    def task(cfg: DictConfig) -> bool:
        from hydra.core.hydra_config import HydraConfig

        from sldvexp.runner import run

        nonlocal missed
        passed = run(cfg, folder=HydraConfig.get().runtime.output_dir)
        missed = missed or not passed
        return passed

    try:
        registry.load()
        conf = str(conf_dir())
        hydra.main(version_base="1.3", config_path=conf, config_name="config")(task)()
    except KeyboardInterrupt:
        print("sldvexp: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except Exception as error:
        told = complaints.sentence(error, sys.argv[1:])
        if full_error or told is None:
            raise
        logging.getLogger(__name__).debug("the error in full", exc_info=error)
        for line in told.splitlines():
            print(f"sldvexp: {line}", file=sys.stderr)
        sys.exit(FAILED)
    sys.exit(MISSED if missed else 0)


if __name__ == "__main__":
    main()
