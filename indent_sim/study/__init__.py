"""One scene, varied: many runs, one table. A failed run stays a row.

    StudyFile --cases.of--> Case, Case, ... --conduct--> result folders --table.rows--> study.csv, study.png

`carry_out` walks the whole chain.
"""

from __future__ import annotations

from indent_sim.study.conduct import Study, as_json, carry_out
from indent_sim.study.file import StudyFile, read
from indent_sim.study.plan import Plan, plan

__all__ = ["Plan", "Study", "StudyFile", "as_json", "carry_out", "plan", "read"]
