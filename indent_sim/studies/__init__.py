"""One scene, varied: many runs, one table. A failed run stays a row.

    StudyFile --cases.asked_for--> Case, Case, ... --conduct--> result folders --study_table.rows-->
    study.csv

`execute_study` walks the whole chain.
"""

from indent_sim.studies.run_study import Study, as_json, execute_study
from indent_sim.studies.study_file import StudyFile, read
from indent_sim.studies.study_plan import StudyPlan, plan_study

__all__ = ["Study", "StudyFile", "StudyPlan", "as_json", "execute_study", "plan_study", "read"]
