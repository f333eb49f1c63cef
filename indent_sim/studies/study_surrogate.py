"""Surrogate of a finished study, with a closed formula and the Sobol indices of its keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from indent_sim.process.errors import UsageError
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.json_text import to_json
from indent_sim.results.result_files import STUDY, read_report, refuse_foreign
from indent_sim.studies import many_runs_picture, sobol_indices, study_file, study_folder
from indent_sim.studies.formula_file import formula_entry, formula_summary, write_formula
from indent_sim.studies.formula_fit import fit_closed_formula
from indent_sim.studies.study_file import StudyFile
from indent_sim.studies.surrogate import Surrogate, surrogate_file, write_surrogate
from indent_sim.studies.surrogate_fit import fit_surrogate, read_table, surrogate_summary


@dataclass(frozen=True)
class StudySurrogate:
    """Surrogate of a study that has been written into its folder.

    Attributes
    ----------
    path, surrogate
        The file and the surrogate.
    sobol
        Sobol indices by key: first, total and error; empty if there are none.
    notes
        Lines on groups, range, error, closed formula and Sobol indices.
    """

    path: Path
    surrogate: Surrogate
    sobol: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the result as an object for JSON."""
        names = ("column", "error")
        formula = self.surrogate.information["formula"]
        others = {"formula": formula, "sobol": self.sobol, "notes": self.notes}
        return (
            {"file": str(self.path)}
            | others
            | {name: getattr(self.surrogate, name) for name in names}
        )


def make_surrogate(
    study_input: Path | str | Mapping[str, Any],
    column: str,
    *,
    within: float | None = None,
    output: Path | None = None,
) -> StudySurrogate:
    """Fit a surrogate to the finished table of a study, and write its file into the folder.

    A closed formula of few coefficients is in this file, and in two files of text beside it.
    If the keys of the study are sampled independently, the Sobol indices of the force are written
    to study.json and sobol.png.

    Parameters
    ----------
    study_input
        Path of a study file, or a dictionary with its structure.
    column, within
        See `fit_surrogate`.
    output
        Folder of the study; by default the folder that the study file names.

    Raises
    ------
    UsageError, VerificationError
        See `fit_surrogate`.
    """
    study = study_file.read(study_input)
    directory = output or study.directory
    record = read_report(directory, STUDY)
    if not record:
        raise UsageError(f"{directory} has no study", "run the study first", str(directory))
    refuse_foreign(directory, "study", (study_folder.SOBOL_PICTURE,))
    surrogate = fit_surrogate(study, directory, column, within)
    surrogate = _with_formula(study, directory, surrogate)
    path = directory / surrogate_file(column)
    write_surrogate(surrogate, path)
    write_formula(surrogate, directory)
    notes = [*surrogate_summary(surrogate), *formula_summary(surrogate, directory)]
    sobol: dict[str, dict[str, float]] = {}
    if column == "force" and any(block.sample for block in study.blocks):
        try:
            sobol = sobol_indices.indices_of_study(study, surrogate)
        except UsageError as error:
            notes.append(f"no Sobol indices: {error}")
    if sobol:
        notes += [
            f"{key}: alone {shares['first']:.3f}, with others {shares['total']:.3f} of the variance"
            f" of the force, +- {shares['error']:.1g}"
            for key, shares in sobol.items()
        ]
        write_atomically(directory / STUDY, to_json(record | {"sobol": sobol}) + "\n")
        picture = directory / study_folder.SOBOL_PICTURE
        many_runs_picture.draw_sobol_indices(sobol, column, study.title, picture)
    return StudySurrogate(path, surrogate, sobol, tuple(notes))


def _with_formula(study: StudyFile, directory: Path, surrogate: Surrogate) -> Surrogate:
    """Return the surrogate with a closed formula, or with the reason why it has none."""
    formula = None
    if surrogate.is_logarithmic:
        table = read_table(study, directory, surrogate.column)
        formula = fit_closed_formula(surrogate, table.keys, table.column)
    entry = {"formula": formula_entry(surrogate.column, formula)}
    return replace(surrogate, information={**surrogate.information, **entry})
