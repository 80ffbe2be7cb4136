"""Bad input: a command line with its files, and how it must be answered."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

EXPERIMENT = """# @package _global_
defaults:
  - override /pose: registration
  - _self_
pose:
  path: conf://data/figure_4_28.reg
"""

Content = str | bytes | Callable[[Path], object]


@dataclass
class Bad:
    """A command line, what it must be answered (`…` stands for any text), and its files."""

    arguments: str
    answer: str
    files: dict[str, Content] = field(default_factory=dict)

    def write_files(self, folder: Path) -> None:
        """Write the files where the command runs."""
        for name, content in self.files.items():
            file = folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            if callable(content):
                content(file)
            else:
                file.write_bytes(content if isinstance(content, bytes) else content.encode())

    def answered_by(self, errors: str, folder: Path) -> bool:
        """Compare the whole of what the command complained, which is one line."""
        wanted = f"sldvexp: {self.answer.replace('{here}', str(folder))}\n"
        pattern = ".*".join(map(re.escape, wanted.split("…")))
        return re.fullmatch(pattern, errors) is not None  # `.` matches no line break


def on_pose(arguments: str, answer: str) -> Bad:
    return Bad(f"experiment=pose {arguments}", f"command line: {answer}")


def in_folder(arguments: str, answer: str, **files: Content) -> Bad:
    """With a --config-dir; `experiment_x` is the name of my/experiment/x.yaml."""
    content = {f"my/{n.replace('_', '/', 1)}.yaml": text for n, text in files.items()}
    return Bad(f"--config-dir my {arguments}", f"my/{answer}", content)


def on_experiment(added: str, answer: str) -> Bad:
    return in_folder("experiment=x", f"experiment/x.yaml{answer}", experiment_x=EXPERIMENT + added)


def on_given(views: str, answer: str) -> Bad:
    arguments = f"~experiment pose=given 'pose.views={{front: {views}}}'"
    return Bad(arguments, answer)
