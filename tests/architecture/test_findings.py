"""What a finding is about stands in its fields: no one reads it out of its words."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2] / "sldvexp"


def of_one_view(subject: ast.expr) -> bool:
    """Tell whether a subject is written as that of one view: f"view {name}", or of its pixels."""
    first = subject.values[0] if isinstance(subject, ast.JoinedStr) else None
    words = str(first.value) if isinstance(first, ast.Constant) else ""
    return words in ("view ", "pixels of view ")


def test_findings_whose_subject_is_a_view_carry_its_name():
    seen, without = 0, []
    for path in sorted(ROOT.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "Finding(" not in text:
            continue
        tree = ast.parse(text)
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            name = getattr(call.func, "attr", getattr(call.func, "id", ""))
            if name == "Finding" and len(call.args) > 1 and of_one_view(call.args[1]):
                seen += 1
                if not any(word.arg == "views" for word in call.keywords):
                    without.append(f"{path.relative_to(ROOT)}:{call.lineno}")
    assert without == []
    assert seen > 15
