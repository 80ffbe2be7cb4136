"""`sldvexp-lab` command: the virtual lab of a configuration as a server on this machine."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from sldvexp.config import composing
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import conf_dir
from sldvexp.errors import UserError, nearest
from sldvexp.stopping import heed
from sldvexp.virtual_lab.lab import VirtualLab
from sldvexp.virtual_lab.scene import Scene
from sldvexp.virtual_lab.server import LabServer

#: Where `instrument=visa` looks for it.
PORT = 5025
#: The largest number of a port.
LAST_PORT = 65535

#: Distance within which a view of the scene is the stand that a rough pose means, m.
SAME_STAND = 0.3

#: Whose lab it is if no experiment is chosen.
EXPERIMENT = "experiment=dissertation/automated_pose"


def main() -> None:
    """Serve until Ctrl-C or SIGTERM.

    Exit status: 0, or 1 with one sentence for a user's mistake.
    """
    heed()
    try:
        options = _parser().parse_args()
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
        As `sldvexp` takes them; of the experiment scene, target, laser and seed matter, and rough
        poses of the scan, see `with_planned_stands`.
    port : int
        0 takes a free one.
    config_dir : str, optional
        Folder with experiments and choices of the user's own.

    Raises
    ------
    UserError
        If the configuration is wrong or has no scene, or the port is not free.
    """
    if not 0 <= port <= LAST_PORT:
        raise UserError(f"--port must be from 0 to {LAST_PORT}, not {port}; 0 takes a free one")
    made = experiment(settings, config_dir)
    if made.scene is None:
        raise UserError(f"there is no scene to serve; choose {' or '.join(scenes(config_dir))}")
    scene, told = with_planned_stands(made)
    lab = VirtualLab(scene, made.laser, made.target, made.seed)
    try:
        server = LabServer(lab, host, port)
    except OSError as error:
        if (error.errno or 0) < 0:  # of a name that nobody knows, as socket.gaierror has it
            unknown = "there is no address of this name; 127.0.0.1 is this machine alone"
            raise UserError(f"--host {host}: {unknown}") from None
        why = f"cannot listen on {host}, port {port}: {os.strerror(error.errno or 0)}"
        raise UserError(f"{why}; --port 0 takes a free one") from None
    with suppress(KeyboardInterrupt), server:
        # In one piece, so that a signal in the midst of it leaves no line without its end.
        print("".join(f"{line}\n" for line in (server.resource, *told)), end="", flush=True)
        server.stopping.wait()
    print(f"the virtual lab at {server.resource} has ended", flush=True)


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


def scenes(config_dir: str | None = None) -> list[str]:
    """List choices of a scene: those of a folder of the user's own, or else the program's."""
    for folder in ([Path(config_dir)] if config_dir else []) + [conf_dir()]:
        if found := sorted((folder / "scene").glob("*.yaml")):
            return [f"scene={path.stem}" for path in found]
    return []


def with_planned_stands(experiment: Experiment) -> tuple[Scene, list[str]]:
    """Have the instrument stand where the scan's rough poses have it, also where no view is.

    A scene has views of its own, which may differ from the rough poses by as much as a person
    fails to meet them. Of a view that it does not have, or has somewhere else, the rough pose is
    taken: so stands that were planned can be tried in any scene.

    Returns
    -------
    Scene, list of str
        And a sentence on each view, where the instrument stands in it.
    """
    scene = experiment.scene
    rough = experiment.scan.rough_poses() if experiment.scan else {}
    key = experiment.scan.rough_poses_key if experiment.scan else ""
    told = []
    views = dict(scene.views)
    for name in {**scene.views, **rough}:
        source, beside = "scene.views", ""
        if name in rough and name in views:
            off = float(np.linalg.norm(views[name].place - rough[name].place))
            beside = f", {off:.3f} m beside {key}"
        if name in rough and (name not in views or off > SAME_STAND):
            views[name], source = rough[name], key
            beside = f", and not {off:.2f} m beside it as scene.views has it" if beside else ""
        if rough and name not in rough:
            beside = f", which {key} does not have; {nearest(name, rough)}"
        at = ", ".join(f"{x:.3f}" for x in views[name].place)
        told.append(f"view {name}: the instrument stands at ({at}) m, from {source}{beside}")
    return replace(scene, views=views), told


class _OneSentence(argparse.ArgumentParser):
    """A parser that tells a mistake as the rest of the program does."""

    def error(self, message: str) -> NoReturn:
        """Raise it as a user's mistake."""
        raise UserError(f"command line: {message}; sldvexp-lab --help lists the options")


def _parser() -> argparse.ArgumentParser:
    parser = _OneSentence(
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
