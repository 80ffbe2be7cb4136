"""`sldvexp-lab` command: the virtual lab of a configuration as a server on this machine."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress

from sldvexp.config import composing
from sldvexp.config.experiment import Experiment
from sldvexp.errors import UserError
from sldvexp.virtual_lab.lab import VirtualLab
from sldvexp.virtual_lab.server import LabServer

#: Where `instrument=visa` looks for it.
PORT = 5025

#: Whose lab it is if no experiment is chosen.
EXPERIMENT = "experiment=dissertation/automated_pose"


def main() -> None:
    """Serve until Ctrl-C. Exit status: 0, or 1 with one sentence for a user's mistake."""
    options = _parser().parse_args()
    try:
        serve(options.settings, options.host, options.port, options.config_dir)
    except UserError as error:
        for line in str(error).splitlines():
            print(f"sldvexp-lab: {line}", file=sys.stderr)
        sys.exit(1)


def serve(
    settings: Sequence[str],
    host: str = "127.0.0.1",
    port: int = PORT,
    config_dir: str | None = None,
) -> None:
    """Start the lab of a configuration, print VISA's name of it, and serve until Ctrl-C.

    Parameters
    ----------
    settings : sequence of str
        As `sldvexp` takes them; of the experiment only scene, target, laser and seed matter.
    port : int
        0 takes a free one.
    config_dir : str, optional
        Folder with experiments and choices of the user's own.

    Raises
    ------
    UserError
        If the configuration is wrong or has no scene, or the port is not free.
    """
    made = experiment(settings, config_dir)
    if made.scene is None:
        raise UserError("there is no scene to serve; choose scene=calibration or scene=plate")
    lab = VirtualLab(made.scene, made.laser, made.target, made.seed)
    try:
        server = LabServer(lab, host, port)
    except OSError as error:
        told = f"cannot listen on {host}, port {port}: {os.strerror(error.errno or 0)}"
        raise UserError(f"{told}; --port 0 takes a free one") from None
    with server, suppress(KeyboardInterrupt):
        print(server.resource, flush=True)
        server.stopping.wait()


def experiment(settings: Sequence[str], config_dir: str | None = None) -> Experiment:
    """Make the plugins of a configuration, `EXPERIMENT` if it does not choose another.

    Raises
    ------
    UserError
        If something is wrong with it.
    """
    if not any(s.lstrip("~").startswith("experiment") for s in settings):
        settings = [EXPERIMENT, *settings]
    return composing.made_from(settings, config_dir)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sldvexp-lab",
        description="Serve the virtual lab of a configuration to instrument=visa.",
        epilog="Examples: sldvexp-lab scene=plate target=two_planes laser=ometron_16bit seed=3; "
        "sldvexp-lab --config-dir lab experiment=my_plate",
    )
    parser.add_argument("settings", nargs="*", metavar="key=value", help="as sldvexp takes them")
    parser.add_argument("--config-dir", help="folder with experiments and choices of your own")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (%(default)s)")
    parser.add_argument(
        "--port", type=int, default=PORT, help="0 takes a free one (default: %(default)s)"
    )
    return parser


if __name__ == "__main__":
    main()
