"""`sldvexp-lab` command: the virtual lab of a configuration as a server on this machine."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress

from hydra import compose, initialize_config_dir
from hydra.errors import MissingConfigException
from omegaconf import DictConfig

from sldvexp.config import Origins, hydra_plugin, messages, registry, schema
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import conf_dir
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
        serve(options.settings, options.host, options.port)
    except UserError as error:
        for line in str(error).splitlines():
            print(f"sldvexp-lab: {line}", file=sys.stderr)
        sys.exit(1)


def serve(settings: Sequence[str], host: str = "127.0.0.1", port: int = PORT) -> None:
    """Start the lab of a configuration, print VISA's name of it, and serve until Ctrl-C.

    Parameters
    ----------
    settings : sequence of str
        As `sldvexp` takes them; of the experiment only scene, target, laser and seed matter.
    port : int
        0 takes a free one.

    Raises
    ------
    UserError
        If the configuration is wrong or has no scene, or the port is not free.
    """
    made = experiment(settings)
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


def experiment(settings: Sequence[str]) -> Experiment:
    """Make the plugins of a configuration, `EXPERIMENT` if it does not choose another.

    Raises
    ------
    UserError
        If something is wrong with it.
    """
    if not any(s.lstrip("~").startswith("experiment") for s in settings):
        settings = [EXPERIMENT, *settings]
    origins = Origins(list(settings))
    hydra_plugin.install()
    try:
        composed = _composed(settings)
    except Exception as error:
        raise UserError(messages.of_composition(error, origins)) from error
    try:
        return schema.build(composed)
    except Exception as error:
        if told := messages.sentence(error, origins):
            raise UserError(told) from error
        raise


def _composed(settings: Sequence[str]) -> DictConfig:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        try:
            return compose("config", overrides=list(settings))
        except MissingConfigException:
            # Perhaps a scene or a target of an installed package, which only now are looked for.
            if not registry.load_installed():
                raise
            return compose("config", overrides=list(settings))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sldvexp-lab",
        description="Serve the virtual lab of a configuration to instrument=visa.",
        epilog="Example: sldvexp-lab scene=plate target=two_planes laser=ometron_16bit seed=3",
    )
    parser.add_argument("settings", nargs="*", metavar="key=value", help="as sldvexp takes them")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (%(default)s)")
    parser.add_argument(
        "--port", type=int, default=PORT, help="0 takes a free one (default: %(default)s)"
    )
    return parser


if __name__ == "__main__":
    main()
