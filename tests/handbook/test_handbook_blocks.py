"""Blocks of the handbook: what stands there as a command, a program or a file runs as it stands.

Kinds of blocks, by the word behind the backquotes:

console
    Lines that begin with ``$`` are run in the page's folder, one after the other; lines between
    them must be in what the command says. Behind it may stand ``# exit status 2``.
python
    Is run in the same folder; all blocks of a page share their names.
yaml, text and others with a file's name behind the word
    Are written under that name. A yaml block, with or without a name, is checked as a
    configuration if it is one.
sh
    Installs something, or needs a cluster or an instrument: is not run, its words are checked.
text
    Is output, a drawing or an equation.

With the word long a block takes longer, and runs with ``-m long`` only.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml
from handbook_pages import PAGES, group_of, sections

from sldvexp import dataset
from sldvexp.config import Origins, hydra_plugin, schema
from sldvexp.dataset import CONVENTIONS
from tests.plot.conftest import SMALL

BLOCK = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
KINDS = {"console", "python", "yaml", "text", "sh", "csv"}

#: Attributes that other programs ask for, or that say nothing of the run.
UNTOLD = ("Conventions", "title")
#: How the first page runs it, which here is done once for all pages.
BARE = "sldvexp hydra.run.dir=outputs/first"
#: Servers of this machine that a page starts with an ampersand.
BACKGROUND = re.compile(r"(sldvexp-lab .*) &$")
#: Comment behind a command that ends with another exit status than zero.
STATUS = re.compile(r"# exit status (\d)")
#: Pages whose blocks are whole sessions.
SESSIONS = {
    "choosing_a_method",
    "figures",
    "first_hour",
    "first_instrument",
    "formats",
    "models",
    "other_instruments",
    "own_experiments",
    "own_files",
    "own_plate",
    "planning",
    "python",
    "sweeps",
    "velocity_images",
}
OUTPUT_IS_CUT = "..."


@dataclass
class Block:
    """One block of a page."""

    kind: str
    words: list[str]
    text: str

    @property
    def long(self) -> bool:
        """Whether it runs with ``-m long`` only."""
        return "long" in self.words

    @property
    def file(self) -> str | None:
        """Name of the file that it is written to."""
        return next((word for word in self.words if word != "long"), None)

    @property
    def calls(self) -> list[tuple[str, list[str]]]:
        """Commands of a console with the lines that each prints."""
        found: list[tuple[str, list[str]]] = []
        for line in self.text.replace("\\\n", "").splitlines():
            if line.startswith("$ "):
                found.append((" ".join(line[2:].split()), []))
            elif line.strip():
                found[-1][1].append(line)
        return found


def blocks(topic: str) -> list[Block]:
    """All blocks of a page."""
    return [Block(kind, words.split(), text) for kind, words, text in BLOCK.findall(PAGES[topic])]


@dataclass
class Reader:
    """Somebody who does what a page says, in an empty folder.

    Parameters
    ----------
    call : callable
        Runs the command with arguments.
    bare : Path
        A run of the default session that stands for the one of the first page.
    long : bool
        Whether long blocks are done too, and that run for real.
    """

    call: Callable
    bare: Path
    long: bool
    names: dict[str, object] = field(default_factory=dict)
    servers: list[subprocess.Popen] = field(default_factory=list)

    def do(self, block: Block) -> bool:
        """Do what a block says; whether there was anything to do."""
        if block.file:
            path = Path(block.file)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        if block.kind == "yaml":
            check_configuration(block)
        elif block.kind == "python" and not block.file:
            exec(compile(block.text, "handbook", "exec"), self.names)
        elif block.kind == "console":
            for command, lines in block.calls:
                said = self.run(command)
                for line in lines:
                    for part in filter(str.strip, line.split(OUTPUT_IS_CUT)):
                        assert " ".join(part.split()) in said, (command, part, said[-3000:])
        return block.kind in ("console", "python") or bool(block.file) or block.kind == "yaml"

    def run(self, command: str) -> str:
        """Run one command and give what it says, with single spaces."""
        if command == BARE and not self.long:
            shutil.copytree(self.bare, "outputs/first", ignore=shutil.ignore_patterns("journal"))
            return ""
        if started := BACKGROUND.match(command):
            program, *words = shlex.split(started[1])
            script = [sys.executable, "-m", "sldvexp.virtual_lab.console", *words]
            assert program == "sldvexp-lab"
            self.servers.append(subprocess.Popen(script, stdout=subprocess.PIPE, text=True))
            assert self.servers[-1].stdout
            self.servers[-1].stdout.readline()
            return ""
        program, *words = shlex.split(command, comments=True)
        if program == "sldvexp":
            done = self.call(*words)
            status = int((STATUS.search(command) or [0, 0])[1])
            assert done.status == status, (command, done.err, done.out[-3000:])
            return " ".join(f"{done.out} {done.err}".split())
        script = [sys.executable if program == "python" else program, *words]
        run = subprocess.run(script, capture_output=True, text=True, check=False)
        assert run.returncode == 0, (command, run.stderr)
        return " ".join(f"{run.stdout} {run.stderr}".split())

    def leave(self) -> None:
        """Stop what was started."""
        for server in self.servers:
            server.terminate()
            server.wait()


def check_configuration(block: Block) -> None:
    """Check a block of YAML: an experiment, whole or a part, against the schema."""
    if block.file and "/experiment/" not in block.file:
        assert yaml.safe_load(block.text) is not None
        return
    name = Path(block.file).stem if block.file else "of_a_page"
    folder = Path(block.file).parents[1] if block.file else Path("checked")
    if not block.file:
        head = "" if "@package" in block.text else "# @package _global_\n"
        path = folder / f"experiment/{name}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(head + block.text, encoding="utf-8")
    hydra_plugin.install()  # as a command does first
    origins = Origins(["--config-dir", str(folder), f"experiment={name}"])
    config = origins.compose()
    task = config.copy()
    task._set_flag("struct", False)
    del task["hydra"]
    schema.build(task)


@pytest.fixture(scope="module")
def bare(run_once: Callable[..., Path]) -> Path:
    """Folder of a small run of the default session, the one that figures are drawn of."""
    return run_once(*SMALL)


@pytest.fixture
def reader(sldvexp: Callable, bare: Path, request: pytest.FixtureRequest) -> Iterator[Reader]:
    """A reader in an empty folder but for a run's file."""
    shutil.copy(bare / "run.nc", "run.nc")
    one = Reader(sldvexp, bare, long=request.node.get_closest_marker("long") is not None)
    yield one
    one.leave()


def read(
    topic: str, reader: Reader, record_property: Callable[[str, object], None], long: bool
) -> None:
    """Do all blocks of a page, and record how many there were."""
    done = [reader.do(block) for block in blocks(topic) if long or not block.long]
    record_property("handbook blocks", sum(done))


@pytest.mark.parametrize(
    "topic",
    [pytest.param(t, marks=[pytest.mark.whole] * (t in SESSIONS)) for t in PAGES if blocks(t)],
)
def test_blocks_of_a_page_run_as_they_stand(topic, reader, record_property):
    read(topic, reader, record_property, long=False)


@pytest.mark.long
@pytest.mark.parametrize("topic", [t for t in PAGES if any(b.long for b in blocks(t))])
def test_blocks_of_a_page_run_as_they_stand_with_those_that_take_longer(
    topic, reader, record_property
):
    read(topic, reader, record_property, long=True)


def test_attributes_of_a_run_are_told(bare):
    told = {group_of(title): text for title, text in sections("reading_a_result").items()}
    with dataset.load(bare / "run.nc") as tree:
        for node in tree.subtree:
            group = re.sub(r"^(edge|image)/.*", r"\1", node.path.strip("/")) or "The root"
            group = re.sub(r"^compare/.*", "field", group)
            missing = {name for name in node.attrs if f"`{name}`" not in told.get(group, "")}
            assert group.startswith("examined/") or missing <= {*CONVENTIONS, *UNTOLD}, group


def test_every_block_has_a_kind():
    for topic in PAGES:
        for block in blocks(topic):
            assert block.kind in KINDS, (topic, block.text)
            assert block.kind == "sh" or "sldvexp " not in block.text or block.kind != "text"
        assert len(re.findall("^```", PAGES[topic], re.MULTILINE)) == 2 * len(blocks(topic))


def test_wrong_blocks_are_seen(reader):
    for kind, text in (
        ("python", "assert 1 == 2"),
        ("console", "$ sldvexp list\nno such line\n"),
        ("console", "$ sldvexp lst\n"),
        ("yaml", "pose: {path: mine.reg}\nposse: {}\n"),
    ):
        with pytest.raises(Exception):  # noqa: B017, PT011
            reader.do(Block(kind, [], text))
