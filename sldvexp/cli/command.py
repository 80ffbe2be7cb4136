"""Calls of the `sldvexp` command: composed and run, and mistakes told in a sentence.

Nothing heavy is loaded: help, completion and ``--cfg`` answer at once. Rooms that not every call
needs are imported as a whole, and load a module when a name of it is first used.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import logging
import os
import sys
import warnings
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, MissingConfigException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict, read_write

from sldvexp import cli, config, pipeline, session, sweep, telling, writing
from sldvexp.cli import commands
from sldvexp.config import registry
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import RUN_FILE, conf_dir
from sldvexp.errors import UserError, words_of
from sldvexp.lazy import numpy_alone, without_docstrings
from sldvexp.limits import shown
from sldvexp.stopping import end_with, exit_status, heed, this_process
from sldvexp.writing import require_no_links

log = logging.getLogger(__name__)

DONE, FAILED, MISSED = 0, 1, 2

FULL_ERROR = "HYDRA_FULL_ERROR"

#: Another way to say ``-m``.
MULTIRUN = "hydra.mode=MULTIRUN"

#: Number of a setting of GNU's malloc: how many heaps there are at most.
ARENA_MAX = -8

#: How many objects are made between searches for garbage, a tenth of which Python makes by default:
#: hardly any is in circles, and a run would take 0.3 s for it.
SELDOM = (7000, 10, 10)

USUAL_WARNING = warnings.formatwarning

# Before numpy comes: the bits of a result should not depend on how many processors a machine has,
# and runs side by side should not fight for them. A large dense system alone takes a third longer.
for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")


def main(asked: Sequence[str]) -> None:
    """Compose the configuration, run it, and turn a user's mistake into one sentence.

    Exit status: 0 done, 1 not done (one sentence on standard error), 2 done but an expectation
    was missed, 130 interrupted, 143 and 129 ended by SIGTERM and SIGHUP, which stop a run as Ctrl-C
    does. With HYDRA_FULL_ERROR=1 in the environment a mistake shows where
    in the program it was found.

    Parameters
    ----------
    asked : sequence of str
        Names of questions of which the answer is kept, see `sldvexp.cli.answers`; may be empty.
    """
    warnings.formatwarning = _warning
    gc.disable()  # composing makes many objects and no garbage; a job turns it on again
    atexit.register(gc.freeze)  # a process that ends need not look for garbage, which takes 0.4 s
    gc.set_threshold(*SELDOM)
    without_docstrings()
    heed()
    try:
        with hydra_raises() as full_error:
            status = _answered(Command(sys.argv[1:], full_error), asked)
    except KeyboardInterrupt as stop:
        telling.tell(str(stop) or "interrupted", telling.YELLOW)
        status = exit_status(stop)
    finally:
        telling.clear_note()
        gc.enable()
    sys.exit(status)


def _answered(command: Command, asked: Sequence[str]) -> int:
    """Run a command, and keep what it prints if that is the answer to questions."""
    if not asked:
        return command.run()
    with cli.answers.keeping(asked) as keep:
        status = command.run()
        strange = registry.looked_for_packages() and registry.load_installed()
        keep(status == DONE and not strange and not config.hydra_plugin.others_search())
    return status


@contextmanager
def hydra_raises() -> Iterator[bool]:
    """Let Hydra raise its errors, which we put into words; True if they are wanted in full."""
    wanted = os.environ.get(FULL_ERROR)
    os.environ[FULL_ERROR] = "1"
    try:
        yield wanted == "1"
    finally:
        del os.environ[FULL_ERROR]
        if wanted is not None:
            os.environ[FULL_ERROR] = wanted


def _warning(message: Warning | str, category: type[Warning], *place: Any, **line: Any) -> str:
    """Format a warning: about plugins of others in one sentence, without its place."""
    telling.clear_note()
    if issubclass(category, registry.PluginWarning):
        return f"sldvexp: {shown(str(message))}\n"
    return USUAL_WARNING(message, category, *place, **line)


def _share_one_heap() -> None:
    """Let all threads take memory from one heap, where the C library is GNU's.

    It gives each thread a heap of its own, and in each stays what the largest arrays left: an
    eighth of what a run takes. Threads here ask for few and large pieces, and hardly ever wait.
    """
    with suppress(OSError, AttributeError):  # of another C library
        ctypes.CDLL(None).mallopt(ARENA_MAX, 1)


def _refuse_finished(folder: Path, experiment: Experiment) -> None:
    """Complain about a folder with a finished run, unless it may be replaced."""
    if (folder / RUN_FILE).is_file() and not experiment.overwrite:
        raise UserError(
            f"{folder}: has a finished run; overwrite=true puts this one in its place once it is "
            "done"
        )


def _keep_settings(folder: Path) -> None:
    """Sync what Hydra wrote of a run's settings, with which it goes on after a power cut."""
    if (folder / ".hydra").is_dir():
        writing.sync_all(folder / ".hydra")
    writing.sync(folder)


class Command:
    """One call of the command: one job, or the many of a sweep.

    Parameters
    ----------
    arguments : sequence of str
        The command line without the program's name.
    full_error : bool
        Whether mistakes are raised instead of told.
    quiet : bool
        Whether a single run prints neither a bar nor its closing table.
    watcher : Watcher, optional
        Shows how a single run gets on, in the place of the bar.
    operator : Operator, optional
        Is asked, in the place of the person at the terminal, for what must be done by hand.
    """

    own_process: ClassVar[bool] = True  # nothing else goes on in it

    def __init__(
        self,
        arguments: Sequence[str],
        full_error: bool,
        quiet: bool = False,
        watcher: session.Watcher | None = None,
        operator: session.Operator | None = None,
    ):
        self.quiet = quiet
        self.watcher, self.operator = watcher, operator
        self.arguments = arguments
        self.full_error = full_error
        self.status = DONE
        self.defect: BaseException | None = None
        self.ended: BaseException | None = None  # what ended a run and was told
        self.sweep: sweep.Sweep | None = None
        self.recorded = False  # whether a run's folder says what is run
        self.experiment: Experiment | None = None  # of a single run, checked before it begins
        self.folder: Path | None = None  # of a single run
        self.held = ExitStack()  # its lock

    def __getstate__(self) -> dict[str, Any]:
        """Take along to other processes all but the sweep, which stays in this one."""
        return {**vars(self), "sweep": None, "held": ExitStack(), "owner": this_process()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        end_with(state.pop("owner"))
        vars(self).update(state)
        config.hydra_plugin.install()
        sweep.plan.register_resolver()

    def run(self) -> int:
        """Run every job; the worst exit status of them."""
        try:
            resumed = any(a.startswith(commands.KEY) for a in self.arguments)
            if resumed and "console" not in self.arguments:  # which goes on when it is told to
                self.arguments = commands.arguments_of(self.arguments)
                self.recorded = True
            if "--version" in self.arguments:
                return self._version()
            options = self._options()
            if options.overrides[:1] == ["help"]:
                options.help, options.overrides = True, options.overrides[1:]
            if options.help:
                return self._help(options)
            config.hydra_plugin.install()
            if options.shell_completion and any(o.startswith("query=") for o in options.overrides):
                return self._complete()
            if commands.named(options):
                return self._command(options)
            shown = bool(options.cfg) and not options.info  # of a shown one no plugin is made
            with config.cached_loader.remembering(self._before_run, shown):
                try:
                    self._compose_and_run(options)
                except MissingConfigException:
                    # Perhaps a choice of an installed package, which only now are looked for.
                    if not registry.load_installed():
                        raise
                    self._compose_and_run(options)
        except SystemExit as error:  # a stranger's package must not end the program
            told = config.messages.sentence(error, config.Origins(self.arguments))
            if told is None or self.full_error:
                raise
            self._say(told)
        except BrokenPipeError:  # who reads it, as head does, has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        except Exception as error:
            if self.full_error or error is self.defect:
                raise

            self._say(config.messages.of_composition(error, config.Origins(self.arguments)))
        return self.status

    def _compose_and_run(self, options: Namespace) -> None:
        if not options.cfg and not options.info:
            telling.note("reading the configuration")
        if self._check(options) and not options.multirun:
            self.arguments = [*self.arguments, "-m"]
            options.multirun = True
        start = hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")
        if not options.multirun or options.cfg:
            start(self._job)()
            return

        with sweep.Sweep(options) as runs:
            sys.argv[1:] = runs.arguments(self.arguments)
            self.sweep = runs
            # A mistake starts nothing; Hydra composes a batch only when it is the next.
            jobs = runs.plan.jobs if runs.batched else runs.plan.jobs[:1]
            first, *_ = [config.Origins(self.arguments, [*job]).compose() for job in jobs]
            runs.claim()
            try:
                with runs.watched():
                    start(self._job)()
            except BaseException as error:
                composed = not isinstance(error, HydraException)
                if composed and runs.begun:  # what there is may be looked at
                    runs.finish("")
                raise
            report = OmegaConf.to_object(first.report) if first.report else None
            states = runs.finish(first.sweep.rank, report)  # type: ignore[arg-type]
        worst = FAILED if states - {"done", "missed"} else MISSED if "missed" in states else DONE
        self.status = self.status or worst

    def _command(self, options: Namespace) -> int:
        """Do what a command names; only a user's mistakes are told in a sentence."""
        if options.overrides[0] in commands.OF_RUNS:
            telling.note("loading the program")
        try:
            return commands.run(options)
        except (UserError, BrokenPipeError):
            raise
        except Exception as error:
            if told := config.messages.sentence(error, config.Origins(self.arguments)):
                raise UserError(told) from error
            name = options.overrides[0]
            if isinstance(error, OSError):
                raise UserError(f"{name}: {error.strerror or words_of(error)}") from error
            if name in commands.OF_RUNS and not self.full_error:
                told = words_of(error)
                raise UserError(
                    f"{name} failed with {told}: a file is not as a run leaves it, or the program "
                    f"has a fault; with {FULL_ERROR}=1 in the environment it shows where"
                ) from error
            self.defect = error
            raise

    def _complete(self) -> int:
        """Tell a shell how the line that it is typing may go on."""
        if "COMP_LINE" not in os.environ:
            raise UserError(
                "command line: query= is asked by the shell; -sc install=bash sets it up"
            )
        print("\n".join(cli.completion.suggestions(os.environ["COMP_LINE"])))
        return DONE

    def _help(self, options: Namespace) -> int:
        """Print the page of a command, or that of all; Hydra's own would compose everything."""
        if commands.named(options):
            print(cli.help.of_command(options.overrides[0]), flush=True)
        else:
            print(cli.help.text(cli.list.folders(options.config_dir)), flush=True)
        return DONE

    def _version(self) -> int:

        print(f"sldvexp {metadata.version('sldvexp')}, on Hydra {hydra.__version__}")
        return DONE

    def _before_run(self, cfg: DictConfig) -> None:
        """Refuse what cannot be run while everything in its folder is still as it was.

        What a finished run left stays until the new one is whole; Hydra's files are part of it.

        Raises
        ------
        UserError
            If the configuration is wrong, or its folder has a finished run or one at work.
        """
        HydraConfig.instance().set_config(cfg)
        task = cfg.copy()
        with open_dict(task):
            del task["hydra"]
        try:
            self.experiment = config.schema.build(task)
        except Exception as error:
            if config.messages.sentence(error, config.Origins(self.arguments)) is None:
                self.defect = error
            raise
        telling.note("loading the program")
        folder = Path(cfg.hydra.run.dir)
        self.folder = folder.absolute()
        require_no_links(folder)
        _refuse_finished(folder, self.experiment)
        self.held.enter_context(sweep.lock.alone(folder))
        _refuse_finished(folder, self.experiment)  # by whoever had the lock until now
        if (folder / RUN_FILE).is_file():
            with read_write(cfg.hydra):
                cfg.hydra.run.dir = str(self.folder / writing.NEW)

    def _job(self, cfg: DictConfig) -> None:
        """Do one job; its mistakes are told here, so that a sweep goes on with the next."""
        gc.enable()
        job = HydraConfig.get()
        lines: Any = OmegaConf.to_container(job.overrides, resolve=False)
        origins = config.Origins(self.arguments, [*lines["hydra"], *lines["task"]])

        def told(error: BaseException) -> str | None:
            return config.messages.sentence(error, origins)

        computed = True
        try:
            self._warn_of_mixed_tables(cfg, origins)
            if job.mode is RunMode.MULTIRUN:
                if self.own_process and self.sweep and self.sweep.first:
                    gc.freeze()  # what was loaded and composed lives as long as the process
                    if cfg.stream is None and self.sweep.alike("stream", "experiment"):
                        numpy_alone(to_the_end=True)
                watcher = self.sweep.watcher() if self.sweep else None
                where = job.runtime.output_dir
                computed = sweep.job.perform(cfg, where, lines["task"], told, watcher)
            else:
                assert self.folder is not None
                _keep_settings(Path(job.runtime.output_dir))
                if self.own_process:
                    _share_one_heap()
                    gc.freeze()  # what was loaded and composed lives as long as the process
                    if self.experiment and self.experiment.stream is None:
                        numpy_alone(to_the_end=True)
                with self.held:
                    passed = pipeline.runner.run(
                        cfg,
                        folder=str(self.folder),
                        quiet=self.quiet,
                        experiment=self.experiment,
                        watcher=self.watcher,
                        operator=self.operator,
                    )
                self.status = self.status or (DONE if passed else MISSED)
        except KeyboardInterrupt as stop:
            log.info(str(stop) or "interrupted")
            raise
        except (Exception, SystemExit) as error:
            sentence = told(error)
            log.info(sentence or f"stopped by {type(error).__name__}: {error}")
            if sentence is None or self.full_error:
                self.defect = self.defect or error  # of a sweep's, Hydra raises the first
                raise
            self.ended = error
            self._say(sentence)
        finally:
            if self.sweep:
                self.sweep.tell(job.runtime.output_dir, computed)
            elif job.mode is RunMode.MULTIRUN:  # this is another process than the sweep's
                sweep.sweep.leave_sign(Path(job.runtime.output_dir), computed)

    def _warn_of_mixed_tables(self, cfg: DictConfig, origins: config.Origins) -> None:
        """Say which tables have entries of an example; if that fails, the job goes on."""
        try:
            for mixed in config.mixed_tables.mixed_tables(cfg, origins):
                log.warning(mixed)
        except Exception as error:
            if self.full_error:
                raise
            told = config.messages.of_composition(error, origins)
            log.warning(f"it is not known which entries of tables come from an example: {told}")

    def _options(self) -> Namespace:
        """Parse the options, all of which are Hydra's.

        A wrong one is a user's mistake like others.
        """
        config.security.require_bounded_line("command line", self.arguments)
        parser = get_args_parser()
        commands.add_options(parser, self.arguments)

        def refuse(message: str) -> NoReturn:
            raise UserError(f"command line: {message}; sldvexp --hydra-help lists the options")

        parser.error = refuse  # type: ignore[method-assign]
        arguments = commands.in_order(self.arguments, parser)
        self.arguments = [commands.with_bare_names(a) if "{" in a else a for a in arguments]
        if MULTIRUN in self.arguments:  # a sweep, as -m says it
            self.arguments = [*(a for a in self.arguments if a != MULTIRUN), "-m"]
        sys.argv[1:] = self.arguments
        return parser.parse_args(self.arguments)

    def _check(self, options: Namespace) -> bool:
        """Check that files that do not belong to the program do not make Hydra run code.

        Returns
        -------
        bool
            Whether one of them asks for a sweep.
        """
        if options.config_path:
            raise UserError(
                "command line: --config-path would replace the program's own configuration; "
                "add a folder of yours with --config-dir"
            )
        if options.experimental_rerun:
            raise UserError(
                "command line: --experimental-rerun would run whatever that file says; sldvexp "
                "rerun repeats a run from its run.nc"
            )
        origins = config.Origins(self.arguments)
        if origins.may_have_others or self.recorded:
            config.security.check(origins)
            asked = [x.value("hydra.mode") for x in origins.layers_of_files() if x.outside]
            return "MULTIRUN" in asked
        return False

    def _say(self, told: str) -> None:
        for line in told.splitlines():
            telling.tell(line)
        self.status = FAILED
