"""Tables of sampled studies that a formula computes, for tests of surrogates."""

from __future__ import annotations

import csv
from itertools import islice

from indent_sim import studies
from indent_sim.studies.cases import CaseBuilder
from indent_sim.studies.surrogate_fit import CHECKED_RUNS

SCENE = {
    "body": {"shape": "half_space"},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.01, "steps": 1},
}
RANGES = {
    "material.E": {"from": 1, "to": 1000, "spacing": "log"},
    "material.nu": {"from": 0.1, "to": 0.5},
    "indenter.R": {"from": 0.5, "to": 5, "spacing": "log"},
    "loading.delta": {"from": 0.01, "to": 0.05},
}


def hertz(keys, exponent=1.5):
    """Force of a paraboloid on a half-space."""
    return (
        4
        / 3
        * keys["material.E"]
        / (1 - keys["material.nu"] ** 2)
        * keys["indenter.R"] ** (2 - exponent)
        * keys["loading.delta"] ** exponent
    )


def study_with_table(folder, force, count=400, **changes):
    """A sampled study whose table has been computed by a formula."""
    study = studies.read(
        {"base": SCENE, "vary": RANGES, "sample": {"count": count}, "output": {"runs": "none"}}
        | changes
    )
    points = [{key: value for key, value, _ in point} for point in study.iterate_points()]
    build_case = CaseBuilder(study.common_settings)
    requests = enumerate(islice(study.iterate_requests(), CHECKED_RUNS))
    names = {index: build_case(index, request).name for index, request in requests}
    with open(folder / "study.csv", "w", newline="") as stream:
        columns = ("index", "run", *study.keys, "status", "force", "stated_error")
        writer = csv.DictWriter(stream, columns)
        writer.writeheader()
        for index, point in enumerate(points):
            cells = {"index": index + 1, "status": "done", "force": force(point)}
            cells["run"] = names.get(index, "")
            writer.writerow(point | cells)
    return study
