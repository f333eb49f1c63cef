"""PETSc options that a scene may give: numbers, switches and words of its linear algebra.

Scenes come from other people, and PETSc can do anything on behalf of an option: pipe a viewer or a monitor through a
shell, overwrite a file, import Python. So an option is allowed by name, and its value by type; nothing else is passed
on. Each table holds names without the prefix of an inner solver, as in mg_levels_ksp_type. What ends PETSc 3.18 by a
signal is left out too: eisenstat, the lengths of fcg, superlu, the orderings wbm and spectral, and of boomeramg the
interpolations for blocks and relaxation by CG, and by elimination on other levels than the coarsest.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Any

from indent_sim.process.errors import ConfigError

LARGEST = 10**6  # of a whole number: more iterations, levels or blocks are no solver
MOST_NUMBERS = 12  # in a list such as 0,0.1,0,1.1
INNER = ("mg_levels_", "mg_levels_N_", "mg_coarse_", "mg_fine_", "sub_", "fieldsplit_N_", "esteig_", "redundant_",
         "ksp_")  # fmt: skip
_PREFIX = re.compile(r"(?:mg_levels_(?:\d{1,2}_)?|mg_coarse_|mg_fine_|sub_|fieldsplit_\d_|esteig_|redundant_"
                     r"|ksp_(?=ksp_|pc_))*")  # fmt: skip
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d{1,3})?")


def _names(stem: str, endings: str) -> set[str]:
    return {stem + ending for ending in endings.split()}


def _each(stem: str, endings: str, words: str) -> dict[str, frozenset[str]]:
    return {stem + ending: frozenset(words.split()) for ending in endings.split()}


WHOLE = {
    *_names("ksp_", "max_it check_norm_iteration gmres_restart gcr_restart lgmres_augment bcgsl_ell"),
    *_names("ksp_", "chebyshev_esteig_steps"),
    *_names("pc_", "asm_blocks asm_local_blocks asm_overlap gasm_overlap gasm_total_subdomains bjacobi_blocks"),
    *_names("pc_", "bjacobi_local_blocks redundant_number sor_its sor_lits factor_levels"),
    *_names("pc_mg_", "levels multiplicative_cycles"),
    *_names("pc_gamg_", "agg_nsmooths aggressive_coarsening square_graph coarse_eq_limit process_eq_limit"),
    "pc_fieldsplit_block_size",
    *_names("pc_hypre_boomeramg_", "max_levels max_iter agg_nl agg_num_paths P_max nodal_coarsen nodal_coarsen_diag"),
    *_names("pc_hypre_boomeramg_", "numfunctions min_coarse_size max_coarse_size smooth_num_levels smooth_num_sweeps"),
    *_names("pc_hypre_boomeramg_", "grid_sweeps_all grid_sweeps_up grid_sweeps_down grid_sweeps_coarse interp_refine"),
    *_names("pc_hypre_boomeramg_", "vec_interp_variant vec_interp_qmax restriction_type"),
    *_names("pc_hypre_", "pilut_maxiter pilut_factorrowsize parasails_nlevels"),
    *_names("snes_", "lag_jacobian lag_preconditioner max_linear_solve_fail linesearch_max_it linesearch_order"),
    # not those of printing (1-4), of other input (5, 9, 18-21, 25, 26, 30-32, 34) and of files (22)
    *_names("mat_mumps_icntl_", "6 7 8 10 11 12 13 14 15 23 24 27 28 29 33 35 36 37 38 48 49 58"),
}  # fmt: skip
NUMBERS = {
    *_names("ksp_", "rtol atol divtol gmres_haptol gmres_breakdown_tolerance richardson_scale bcgsl_xres"),
    *_names("pc_factor_", "fill zeropivot shift_amount column_pivot nonzeros_along_diagonal"),
    *_names("pc_", "sor_omega sor_diagonal_shift gamg_threshold_scale kaczmarz_lambda"),
    *_names("pc_hypre_boomeramg_", "tol strong_threshold truncfactor max_row_sum relax_weight_all"),
    *_names("pc_hypre_boomeramg_", "outer_relax_weight_all"),
    *_names("pc_hypre_", "pilut_tol parasails_thresh parasails_filter parasails_loadbal"),
    *_names("snes_", "linesearch_damping linesearch_maxstep linesearch_minlambda linesearch_alpha"),
    *_names("snes_", "linesearch_rtol linesearch_atol linesearch_ltol ksp_ew_rtol0 ksp_ew_rtolmax"),
    *_names("mat_mumps_cntl_", "1 2 3 4 5 7"),
}
LISTS = {
    *_names("ksp_", "chebyshev_esteig chebyshev_eigenvalues"),
    *_names("pc_", "gamg_threshold gamg_rank_reduction_factors factor_drop_tolerance"),
    *_names("pc_hypre_boomeramg_", "relax_weight_level outer_relax_weight_level"),
    *_names("pc_fieldsplit_", "0_fields 1_fields 2_fields 3_fields"),
}
SWITCHES = {
    *_names("ksp_", "initial_guess_nonzero knoll diagonal_scale diagonal_scale_fix lag_norm cg_single_reduction"),
    *_names("ksp_", "gmres_modifiedgramschmidt gmres_classicalgramschmidt gmres_preallocate richardson_self_scale"),
    *_names("ksp_", "bcgsl_cxpoly bcgsl_mrpoly bcgsl_pinv lgmres_constant chebyshev_esteig_noisy converged_maxits"),
    *_names("ksp_", "converged_use_initial_residual_norm converged_use_min_initial_residual_norm"),
    *_names("pc_factor_", "in_place reuse_fill reuse_ordering diagonal_fill pivot_in_blocks"),
    *_names("pc_sor_", "symmetric backward forward local_symmetric local_backward local_forward"),
    *_names("pc_", "use_amat jacobi_abs jacobi_fixdiagonal kaczmarz_symmetric"),
    *_names("pc_gamg_", "repartition reuse_interpolation use_sa_esteig asm_use_agg sym_graph symmetrize_graph"),
    *_names("pc_gamg_", "use_parallel_coarse_grid_solver cpu_pin_coarse_grids"),
    *_names("pc_fieldsplit_", "detect_saddle_point diag_use_amat off_diag_use_amat dm_splits"),
    *_names("pc_hypre_boomeramg_", "no_CF nodal_relaxation keeptranspose vec_interp_smooth"),
    *_names("pc_", "mg_distinct_smoothup"),
    *_names("snes_", "ksp_ew linesearch_norms linesearch_keeplambda"),
}
_RELAX = (
    "Jacobi sequential-Gauss-Seidel seqboundary-Gauss-Seidel SOR/Jacobi backward-SOR/Jacobi symmetric-SOR/Jacobi "
    "l1scaled-SOR/Jacobi l1-Gauss-Seidel backward-l1-Gauss-Seidel Chebyshev FCF-Jacobi l1scaled-Jacobi"
)
WORDS: dict[str, frozenset[str]] = {
    **_each("ksp_", "type", "preonly richardson chebyshev cg groppcg pipecg fcg cr gcr gmres fgmres lgmres dgmres "
            "pgmres bcgs bcgsl fbcgs fbcgsr ibcgs cgs qmrcgs tfqmr tcqmr bicg minres symmlq lsqr cgne none"),
    **_each("ksp_", "norm_type", "none preconditioned unpreconditioned natural default"),
    **_each("ksp_", "pc_side", "left right symmetric"),
    **_each("ksp_", "convergence_test", "default skip"),
    **_each("ksp_gmres_", "cgs_refinement_type", "refine_never refine_ifneeded refine_always"),
    **_each("pc_", "type", "none lu cholesky ilu icc qr svd jacobi pbjacobi vpbjacobi bjacobi sor asm gasm "
            "gamg hypre mg fieldsplit ksp redundant kaczmarz"),
    **_each("pc_factor_", "mat_solver_type", "petsc mumps superlu_dist umfpack klu cholmod pastix strumpack "
            "mkl_pardiso"),
    **_each("pc_factor_", "mat_ordering_type", "natural nd 1wd rcm qmd rowlength amd external"),
    **_each("pc_factor_", "shift_type", "none nonzero positive_definite inblocks"),
    **_each("pc_", "asm_type gasm_type", "none restrict interpolate basic"),
    **_each("pc_asm_", "local_type", "additive multiplicative"),
    **_each("pc_", "jacobi_type", "diagonal rowmax rowsum"),
    **_each("pc_gamg_", "type", "agg classical"),
    **_each("pc_gamg_", "coarse_grid_layout_type", "compact spread"),
    **_each("pc_mg_", "type", "additive multiplicative full kaskade"),
    **_each("pc_mg_", "cycle_type", "v w"),
    **_each("pc_mg_", "galerkin", "both pmat mat none"),
    **_each("pc_fieldsplit_", "type", "additive multiplicative symmetric_multiplicative schur gkb"),
    **_each("pc_fieldsplit_", "schur_fact_type", "diag lower upper full"),
    **_each("pc_fieldsplit_", "schur_precondition", "self selfp a11 full"),
    **_each("pc_hypre_", "type", "boomeramg pilut parasails"),
    **_each("pc_hypre_", "parasails_sym", "nonsymmetric SPD nonsymmetric,SPD"),
    **_each("pc_hypre_boomeramg_", "cycle_type", "V W"),
    **_each("pc_hypre_boomeramg_", "measure_type", "local global"),
    **_each("pc_hypre_boomeramg_", "coarsen_type", "CLJP Ruge-Stueben modifiedRuge-Stueben Falgout PMIS HMIS"),
    **_each("pc_hypre_boomeramg_", "interp_type", "classical direct multipass multipass-wts ext+i ext+i-cc standard "
            "standard-wts FF FF1"),
    **_each("pc_hypre_boomeramg_", "relax_type_all relax_type_up relax_type_down", _RELAX),
    **_each("pc_hypre_boomeramg_", "relax_type_coarse", f"Gaussian-elimination {_RELAX}"),
    **_each("pc_hypre_boomeramg_", "smooth_type", "Schwarz-smoothers Pilut ParaSails"),
    **_each("snes_", "type", "newtonls newtontr"),
    **_each("snes_", "linesearch_type", "basic bt l2 cp nleqerr"),
}  # fmt: skip


def refused(user: Mapping[str, Any]) -> Iterator[ConfigError]:
    """The options that a scene may not give, and values that are none of their option, an error each."""
    for name, value in user.items():
        if problem := _problem(name, value):
            yield ConfigError(f"solver.petsc.{name}", *problem)


def stem(name: str) -> str:
    """An option without the prefixes of inner solvers: mg_levels_2_ksp_type -> ksp_type."""
    found = _PREFIX.match(name)
    return name[found.end() :] if found else name


def _problem(name: str, value: Any) -> tuple[str, str] | None:
    """What is wrong with one option and what would be right; None when nothing is."""
    option = stem(name)
    if option in WORDS:
        words = ", ".join(sorted(WORDS[option], key=str.lower))
        right = isinstance(value, str) and value.lower() in {word.lower() for word in WORDS[option]}
        return None if right else (f"must be one of {words}, got {_shown(value)}", "")
    for names, is_right, needed in _TYPES:
        if option in names:
            return None if is_right(value) else (f"must be {needed}, got {_shown(value)}", "")
    known = WHOLE | NUMBERS | LISTS | SWITCHES | WORDS.keys()
    match = get_close_matches(option, sorted(known), n=1, cutoff=0.85)
    meant = f"did you mean '{name.removesuffix(option)}{match[0]}'? " if match else ""
    return "a scene may not give PETSc this option", f"{meant}docs/petsc.md lists those it may give"


def _shown(value: Any) -> str:
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= 1e100 and math.isfinite(value)


def _is_whole(value: Any) -> bool:
    return type(value) is int and abs(value) <= LARGEST


def _is_list(value: Any) -> bool:
    """One number, or text of some with commas between them."""
    if not isinstance(value, str):
        return _is_number(value)
    parts = value.split(",", MOST_NUMBERS)
    return len(parts) <= MOST_NUMBERS and all(_NUMBER.fullmatch(part) for part in parts)


_TYPES = (
    (WHOLE, _is_whole, f"a whole number of at most {LARGEST}"),
    (NUMBERS, _is_number, "a number"),
    (LISTS, _is_list, "a number, or some as in 0,0.1,0,1.1"),
    (SWITCHES, lambda value: isinstance(value, bool), "true or false"),
)
