"""The `sldvexp` command. It imports nothing heavy: help, completion and `--cfg` answer at once."""

from __future__ import annotations

import os
import sys

import hydra
from omegaconf import DictConfig

from sldvexp import complaints, registry
from sldvexp.paths import conf_dir

DONE, FAILED, MISSED, INTERRUPTED = 0, 1, 2, 130


def main() -> None:
    """Compose the configuration, run it, and turn a user's mistake into one sentence.

    Exit status: 0 done, 1 not done (one sentence on standard error), 2 done but an expectation
    was missed, 130 interrupted.
    """
    full_error = os.environ.get("HYDRA_FULL_ERROR") == "1"
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises, and we choose the words
    worst = DONE

    def task(cfg: DictConfig) -> None:
        """One job; its mistakes are told here, so that a sweep goes on with the next."""
        from hydra.core.hydra_config import HydraConfig

        from sldvexp.runner import run

        nonlocal worst
        try:
            passed = run(cfg, folder=HydraConfig.get().runtime.output_dir)
            worst = worst or (DONE if passed else MISSED)
        except Exception as error:
            worst = _tell(error, full_error)

    try:
        registry.load()
        hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(task)()
    except KeyboardInterrupt:
        print("sldvexp: interrupted", file=sys.stderr)
        worst = INTERRUPTED
    except Exception as error:
        worst = _tell(error, full_error)
    sys.exit(worst)


def _tell(error: Exception, full_error: bool) -> int:
    """Print a user's mistake as a sentence; raise again what is a defect, or is wanted in full."""
    told = complaints.sentence(error, sys.argv[1:])
    if full_error or told is None:
        raise error
    for line in told.splitlines():
        print(f"sldvexp: {line}", file=sys.stderr)
    return FAILED


if __name__ == "__main__":
    main()
