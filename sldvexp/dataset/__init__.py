"""A run's groups, variables, dimensions and units, and how they are stored.

`variables` is the one place that knows the name, dimensions, unit, shown unit and meaning of every
variable; `group` makes a stage's arrays a dataset by it. `save` writes a run, `open_run` opens one
again; `RunData` is what figures, checks and pages read. To add a variable, add a line to
`VARIABLES`.
"""

from sldvexp.dataset.findings import (
    MODAL_IMAGES,
    VERDICT,
    WITHOUT_POSE,
    Finding,
    Severity,
    findings_of,
    findings_to_dataset,
    is_void,
    take_findings,
    verdict_of,
    views_without_pose,
    with_findings,
)
from sldvexp.dataset.run_data import COMPARED_STRAIN, RunData, Source, read_yaml
from sldvexp.dataset.store import (
    UNREADABLE,
    group,
    in_memory,
    load,
    load_some,
    load_table,
    open_run,
    readable,
    require_bounded,
    require_declared,
    save,
    save_table,
    whole_tree,
)
from sldvexp.dataset.variable import DAC, FREQUENCY, Variable
from sldvexp.dataset.variables import AXES, CONVENTIONS, VARIABLES

__all__ = [
    "AXES",
    "COMPARED_STRAIN",
    "CONVENTIONS",
    "DAC",
    "FREQUENCY",
    "MODAL_IMAGES",
    "UNREADABLE",
    "VARIABLES",
    "VERDICT",
    "WITHOUT_POSE",
    "Finding",
    "RunData",
    "Severity",
    "Source",
    "Variable",
    "findings_of",
    "findings_to_dataset",
    "group",
    "in_memory",
    "is_void",
    "load",
    "load_some",
    "load_table",
    "open_run",
    "read_yaml",
    "readable",
    "require_bounded",
    "require_declared",
    "save",
    "save_table",
    "take_findings",
    "verdict_of",
    "views_without_pose",
    "whole_tree",
    "with_findings",
]
