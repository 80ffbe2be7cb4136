"""Entry of the `sldvexp` command, which loads the program if the answer is not known yet."""

from __future__ import annotations

import sys

from sldvexp import cli
from sldvexp.cli import answers


def main() -> None:
    """Answer, or compose the configuration and run it; see `sldvexp.cli.command`."""
    asked = answers.question(sys.argv[1:])
    known = answers.answer(asked)
    if known is None:
        cli.command.main(asked)
    else:
        answers.tell(known)
        sys.exit()


if __name__ == "__main__":
    main()
