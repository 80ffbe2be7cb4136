"""Entry of the `sldvexp` command, which loads the program if the answer is not known yet."""

from __future__ import annotations

import sys

from sldvexp import cli
from sldvexp.cli import answers, changed_answers


def main() -> None:
    """Answer, or compose the configuration and run it; see `sldvexp.cli.command`."""
    arguments = sys.argv[1:]
    asked = answers.question(arguments)
    known = answers.answer(asked)
    if known is None and asked:
        known = changed_answers.answer(arguments)
    if known is None and arguments in answers.HELP_ALONE:
        known = cli.help.first(asked)
    if known is None:
        names = [asked, changed_answers.name(arguments)] if asked else []
        cli.command.main([name for name in names if name])
    else:
        answers.tell(known)
        sys.exit()


if __name__ == "__main__":
    main()
