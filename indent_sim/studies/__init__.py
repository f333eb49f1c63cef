"""One scene, varied: many runs, one table. A failed run stays a row.

    StudyFile --cases.asked_for--> Case, Case, ... --conduct--> result folders --study_table.rows-->
    study.csv

`carry_out` walks the whole chain.
"""

from indent_sim.studies.conduct import Study, as_json, carry_out
from indent_sim.studies.plan import StudyPlan, plan
from indent_sim.studies.study_file import StudyFile, read

__all__ = ["Study", "StudyFile", "StudyPlan", "as_json", "carry_out", "plan", "read"]
