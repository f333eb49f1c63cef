"""Parameter studies: many runs of one scene with varied keys, or of many scenes, in one table.

    StudyFile --resolve_cases--> Case, ... --run_study--> result folders --study_table--> study.csv

`execute_study` performs all of these steps. A failed run is a row of the table.
"""

from indent_sim.studies.finished_study import Study, as_json
from indent_sim.studies.run_of_interest import execute_run
from indent_sim.studies.run_study import execute_study
from indent_sim.studies.study_file import StudyFile, read
from indent_sim.studies.study_plan import StudyPlan, plan_study
from indent_sim.studies.study_surrogate import make_surrogate

__all__ = [
    "Study",
    "StudyFile",
    "StudyPlan",
    "as_json",
    "execute_run",
    "execute_study",
    "make_surrogate",
    "plan_study",
    "read",
]
