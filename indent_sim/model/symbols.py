"""The glossary: one name per thing, in YAML, Python and CSV alike, with its sign, meaning and
dimension.

A word that means something else in one section has an entry under `section.word` as well.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

WORD_DIMENSION = "word"  # the dimension of a choice, a text or a switch


@dataclass(frozen=True)
class Symbol:
    """One name: what it means, its dimension, how it is written in formulas (LaTeX, may be empty)."""

    name: str
    meaning: str
    dimension: str = WORD_DIMENSION
    latex: str = ""


# Under the heading of each group its entries, `name [dimension] $latex$: meaning`; what goes on is
# indented
GLOSSARY = r"""
## Scene
title: what the scene is about; printed on pictures
units: units that numbers are meant in; one with a unit of its own is converted to them
body: the soft body: its shape and how it is held
material: the elastic law of the body, of its layers where they have none of their own
indenter: the rigid tip: an analytic surface, never meshed
contact: how contact is enforced
loading: the path of the tip: which depths are asked for
experiment: how the curve is measured: adhesion without range, the instrument, oscillations, calibration
mesh: element sizes, and how much of the body is modelled
accuracy [1]: largest relative error of the force at any step, which chooses the mesh; fast = 0.05, balanced = 0.01,
  accurate = 0.001
solver: how the equations are solved
output: what is written, and where
units.length: label of the length unit, for example mm
units.force: label of the force unit, for example N

## Body
shape: which body, or which tip; decides the other keys of its section
radius [length] $r_0$: radius of the cylinder, of the ball, or of the flat punch
height [length] $h$: thickness of the body; it occupies -height <= z <= 0
width [length] $w$: width of the strip; it occupies 0 <= x <= width, in plane strain
base_radius [length] $b$: radius of the flat side on which a cap stands
contact_angle [degrees] $\theta$: of a cap, between base and curved surface; instead of `height`
size [length] $(l_x, l_y, l_z)$: edges of the box [0, l_x] x [0, l_y] x [-l_z, 0]
base: support of the lower face; roller: slides, does not lift; a ball's: docs/conventions.md
sides: support of the walls; roller: no normal displacement
surfaces.contact: name in the file of the surface that the tip may touch; else what faces up
surfaces.base: name in the file of the surface that `base` holds; else what faces down
surfaces.sides: name in the file of the surface that `sides` holds; else what is upright
x_min: support of the wall at x = 0
x_max: support of the wall at the largest x
y_min: support of the wall at y = 0
y_max: support of the wall at the largest y
layers: layers from the top, bonded to one another; their thicknesses add up to the height. Of a cap or ball: concentric
  skins from the surface inwards, and last the core
thickness [length]: thickness of a layer; the last one of a half_space, its substrate, and of a cap or ball, its core,
  have none
layers.material: the layer's material; without it the scene's
surface_tension [energy/length^2] $\gamma$: of the contact surface, touched or free, a force per length; a curved body
  is at rest under it
inclusions: pieces of other matter, each inside one layer and bonded to it
inclusions.center [length]: middle of the inclusion, [x, y, z]; y = 0 in a strip
inclusions.radius [length]: radius of the ball, or of the upright cylinder
inclusions.height [length]: height of the upright cylinder
inclusions.semi_axes [length]: semi-axes of the ellipsoid along x, y and z; in a strip it has no end along y
inclusions.size [length]: edges of the box along x, y and z; in a strip it has no end along y
inclusions.material: the inclusion's material
file: mesh of the body, a .msh, .xdmf, .vtu or .inp file in the scene's folder or below
kinematics: what a mesh from a file is: a section of triangles, or a body of tetrahedra
surfaces: what the file calls the surface that the tip may touch (`contact`), the `base`, and the `sides`; without names
  where each faces says it; the rest is free
regions: materials by what the file calls their cells; the others are of `material`
hash: fingerprint of the mesh that the file must hold; every result has that of its own

## Material
model: the elastic law; decides the other keys of `material`
E [pressure] $E$: Young's modulus
nu [1] $\nu$: Poisson's ratio
E_z [pressure] $E_z$: Young's modulus along the axis z of a transversely isotropic material; E, nu: across it
nu_z [1] $\nu_z$: -eps_plane/eps_z under sigma_z, of a transversely isotropic material
G_z [pressure] $G_z$: shear modulus of planes through the axis z of a transversely isotropic material
mu [pressure] $\mu$: shear modulus (never a friction coefficient)
kappa [pressure] $\kappa$: bulk modulus
C10 [pressure] $C_{10}$: first invariant's coefficient (Mooney-Rivlin, Yeoh)
C01 [pressure] $C_{01}$: second invariant's coefficient (Mooney-Rivlin)
C20 [pressure] $C_{20}$: coefficient of (I1 - 3)^2 (Yeoh)
C30 [pressure] $C_{30}$: coefficient of (I1 - 3)^3 (Yeoh)
alpha [1] $\alpha_i$: exponents of the stretches (Ogden)
Jm [1] $J_m$: limit of I1 - 3 (Gent)
b [1] $b$: how fast the stiffness grows with I1 - 3, as exp(b (I1 - 3)) (Fung)
lambda_m [1] $\lambda_m$: limiting chain stretch (Arruda-Boyce)
G [pressure] $G$: shear modulus N kT of the dry network of N chains per volume (gel)
n_omega [1] $N\Omega$: chains per volume times the volume of a solvent molecule (gel)
chi [1] $\chi$: Flory's parameter of network and solvent (gel)
stretch [1] $\lambda_0$: free swelling of a gel at rest, over the dry network; auto: that in the first bath
lame_lambda [pressure] $\lambda$: first Lamé constant, kappa - 2 mu / 3
flow: fluid in the pores of a drained law: at once the body is undrained, at last its own constants hold
permeability [length^2/(pressure time)] $k$: of the pores over the fluid's viscosity; at finite strain of the deformed
  body
diffusivity [length^2/time] $D$: with which pressure evens out in the confined body, permeability/(storage +
  alpha^2/M_c); instead of `permeability`; of a gel that of the solvent
flow.alpha [1] $\alpha$: Biot's coefficient: share of a growth in volume that the fluid takes; 1: hard grains
material.storage [1/pressure] $S$: of its flow
flow.storage [1/pressure] $S$: fluid taken in per pressure while the volume stays; 0: hard grains and fluid
holmes_mow: permeability of pores that close, ((J - phi0)/(1 - phi0))^alpha exp(M (J^2 - 1)/2) of that at rest
phi0 [1] $\phi_0$: the solid's share of the volume at rest
M [1] $M$: how fast the permeability falls with the volume beyond that share
formulation: displacement alone, or mixed with a pressure for nu near 0.5
relaxation: how the modulus falls with time; the law's own constants are the instantaneous ones
prony [1, time] $[g_i, \tau_i]$: terms [fraction of the instantaneous modulus, time]; E(t) = E (1 - sum g_i (1 -
  exp(-t/tau_i)))
power_law: E(t) = E (t/time)^-exponent
of: what relaxes: all moduli alike, nu being constant, or shear alone, the bulk modulus being constant
exponent [1] $b$: of the power law, between 0 (elastic) and 1 (a liquid)
time [time] $t_0$: at which the power law's modulus is `material.E`
E_star [pressure] $E^*$: plane-strain modulus E / (1 - nu^2)

## Indenter
R [length] $R$: radius of the tip: of the ball, or of a paraboloid or hyperboloid at its apex
half_angle [degrees] $\alpha$: angle between the axis and the flank (a pyramid: the face, a hyperboloid: the asymptote)
tip_radius [length] $\rho$: radius that rounds the apex (and a pyramid's edges, a profile's corners); 0: sharp
faces [1]: number of faces of the pyramid, all alike
rotation [degrees]: turn of the pyramid about z; at 0 one face's normal points along x
points [length] $(r_i, z_i)$: the profile from the apex [0, 0] outward, [r, z] each, straight between
edge_radius [length] $\rho$: radius that rounds the edge of the flat punch; 0: sharp
center [length] $(x_0, y_0)$: where the tip's axis meets the surface, [x, y] or for a strip [x]; default: axis of the
  cylinder, middle of the box or strip

## Contact
method: which algorithm; auto: the program chooses and says why
epsilon_n [pressure/length] $\varepsilon_n$: contact stiffness; falls with E* where shear relaxes
gamma [pressure/length] $\gamma$: stabilisation of Nitsche's method
contact.gap: reference: the gap is tested at the undeformed point, pressure along z; current: at the deformed point,
  pressure along the tip's normal; auto: reference at small strain
lam [pressure] $\lambda_n$: contact multiplier, a pressure >= 0
p [pressure] $p$: normal contact pressure >= 0
friction [1] $f$: Coulomb's friction coefficient, or stick: the surface never slips on the tip
tau [pressure] $\tau$: tangential traction on the body
epsilon_t [pressure/length] $\varepsilon_t$: tangential contact stiffness; auto: epsilon_n

## Loading
delta [length] $\delta$: indentation depth, > 0 pushes in
loading.force [force] $F$: final force of the whole body, > 0 pushes; the depth is found
steps [1]: number of equal steps to `delta` or `force`
deltas [length] $\delta_i$: the depths one by one instead of `delta`, unloading too; < 0: the tip is clear of the body
forces [force] $F_i$: the forces one by one instead of `force`, unloading too; 0: the tip just touches, at delta = 0
history [time, length]: the way of the tip in time, [t, delta] each; with a cantilever or a frame [t, z]
force_history [time, force]: the force in time, [t, force] each
times [time] $t_i$: of the rows of a history; auto: every point and, between them, enough for a curve
per_doubling [1]: of a body that drains, or whose shear relaxes: steps of each length before that doubles, in every
  piece of the history; 4

## Drainage
drainage: where fluid leaves the pores, and into what
drainage.surface: what the tip may touch, where it does not: drained or sealed
drainage.tip: where it does: drained, sealed, or a conductance
drainage.base: of the lower face, as `tip`
drainage.sides: of the walls; auto: drained where they are free
bath [time, pressure] $p_b$: pressure of the fluid around the body, or [t, value] points; at rest there is none; of a
  gel the solvent's chemical potential over kT, 0 for the pure solvent
bath_ramp [time]: time within which a sudden bath comes, evenly; auto: a 75th of the time that fluid takes through the
  contact, at small strain at once
conductance [length/(pressure time)] $X$: flux out over the fluid's pressure above the bath's
pore_pressure [pressure] $p$: of the fluid in the pores, above the bath's
outflow [length^3]: fluid that has left the whole body since rest; < 0 what it has taken up
pore_pressure_max [pressure]: largest pressure of the fluid, above the bath's
drained: of a sudden step in a body that drains, at each vertex of a drained face the height of its elements and p^2
  times its area; for the film part of the error bars alone, in no file
moved [length^3]: fluid that has gone from where it was at rest, out of the body or to another place in it
unbalanced [length^3]: fluid that has neither left nor is there; zero

## Experiment
adhesion: attraction of tip and body: of a contact over a range, of an experiment without
work [energy/length^2] $w$: work of adhesion: the energy that separates a unit of area
range [length]: gap over which attraction falls by e; an experiment's for its Tabor number alone
cantilever: the spring that holds the tip
frame: what gives way beside the body
cantilever.stiffness [force/length] $k$: spring constant of the cantilever; in plane strain per length, a pressure
compliance [length/force] $c$: of the frame; in plane strain times length
frequencies [1/time]: cycles per time of small oscillations about the end of the history: dynamic.csv
calibration: relative uncertainties of the instrument
calibration.stiffness [1]: relative uncertainty of the cantilever's stiffness
calibration.R [1]: relative uncertainty of the tip's radius
t [time] $t$: time
branch: approach, hold or retract of a history; of an equilibrium curve stable or unstable
frequency [1/time]: cycles per time
storage [force/length] $K'$: in-phase stiffness of the contact
loss [force/length] $K''$: out-of-phase stiffness of the contact

## Mesh
h_contact [length] $h$: element size under the tip; auto: at most 0.3 % force error at the last step
h_axis [length]: element size at the tip's axis; from it sizes grow with the distance to h_contact where the deepest
  contact ends; without it a given h_contact is everywhere under the tip
h_edge [length]: element size at the sharp edge of a flat punch, along all of a rounded one that friction shears;
  without it a fraction of h_contact
h_corner [length]: element size at the corners of the section that the contact feels: where a fixed face meets a free
  one, and where it ends close to a side; without it a given h_contact has none of its own there
h_film [length]: element size at drained faces next to the contact, in a section; without it a given h_contact has none
  of its own there
h_inclusions [length]: element size inside each inclusion, in their order; without it by what the force feels of each
h_layers [length]: element size inside each skin of a cap or ball, from the outermost; without it a share of its
  thickness
grading [1]: growth of the element size per unit distance, outside the contact
h_far [length] $h_\infty$: largest element size, far from the tip
order [1]: polynomial order of the displacement; linear elements (1) are gone
refinements [1]: how often every edge of a mesh from a file is halved; without it as often as `accuracy` needs, or never
symmetry: which part is modelled; auto: the smallest the scene allows

## Solver
solver.method: how the scene is solved: by exact theory without a mesh, or on a mesh whose body is condensed to its
  surface or solved whole by Newton's method; auto: the program chooses and says why
linear: how linear systems are solved, by factorisation or iteratively; changes digits below 1e-8 alone
rtol [1]: relative residual at which a step counts as converged; looser ones would fail the audit. At most 1e-10 with
  linear: iterative
max_iterations [1]: most Newton iterations of one step

## Output
directory: result folder, below the working directory; default: results/ and the name of the config
fields: steps whose fields are written for ParaView; last: the deepest and the last; auto: last where a mesh is solved,
  none with theory
nodal_stress: whether the fields have the stress at the nodes, too: the mean over the cells of one region around each,
  weighted by volume
surface: state of the contact surface, point by point
output.surface: steps whose contact surface is written to surface.csv; last: the deepest and the last
output.reactions: whether force_indentation.csv has a column for each force of a support on the body
plot: whether force_indentation.png is drawn

## Results, one row a step
step [1]: number of the requested depth, from 1
force [force] $F$: > 0 pushing, of the whole body; per length in plane strain
a [length] $a$: contact radius; half-width in plane strain; sqrt(area/pi) in 3D
p_max [pressure] $p_{\max}$: largest contact pressure; nominal with gap reference, else true; empty where it is infinite
penetration [length]: how deep the tip is inside the body at the worst contact point
energy [energy] $\Pi$: strain energy plus penalty energy of the whole body
stiffness [force/length] $\mathrm{d}F/\mathrm{d}\delta$: of the load curve at this row
area [area]: contact area, pi a^2; in plane strain its width, 2 a
E_hertz [pressure]: modulus that the half-space formula of the same tip reads off this one row; empty where there is
  none
newton_iterations [1]: linear solves of the step, those of its substeps included
krylov_iterations [1]: iterations of these linear solves and the stiffness's, where iterative
wall_s [s]: wall time since the start of the run
stick_radius [length]: sqrt(area/pi) of the part of the contact that does not slip on the tip; half its width in plane
  strain; with friction
dissipation [energy]: what friction turned into heat since the row before; with friction
side_force_x [force]: force on the tip along x; with friction, where no mirror plane stands across
side_force_y [force]: force on the tip along y, as side_force_x
force_error [force]: half-width of the error bar on the force
a_error [length]: half-width of the error bar on the contact radius
p_max_error [pressure]: half-width of the error bar on the largest pressure
delta_error [length]: half-width of the error bar on a depth that is found for a force
stick_radius_error [length]: half-width of the error bar on the stick radius; with friction
dissipation_error [energy]: half-width of the error bar on the dissipation; with friction
calibration_error [force]: what the instrument's calibration leaves unknown of the force; with a history
reaction [force]: z-reaction of all constrained degrees of freedom; equals the force
reactions [force]: force of each support on the body, by support and axis; of the whole body
intrusion [length]: how deep the tip lies inside the surface beside that which it may touch
roughness [1]: part of p_max by which the contact pressure alternates from node to node of the elements
overlap [length]: how deep a whole surface facet lies inside the tip's own shape; current gap
stray_reaction [force]: reaction of the constraints that only remove rigid modes; zero
substeps [1]: how many solves the step was cut into
converged: whether the step has a solution
reason: why a step has no solution

## What is known of an attraction over a range
cohesive_zone [length]: cohesive zone
elements [1]: elements in the cohesive zone
tabor [1]: Tabor number
maugis_lambda [1] $\lambda$: Maugis' lambda
maugis_pull_off [force]: pull-off by Maugis-Dugdale on a half-space
jkr_pull_off [force]: pull-off without range (JKR)

## The largest pull of an attraction over a range
largest_pull: the row that is pulled most: {step, delta, force}
pull_off: the largest pull between rows on the way out: {delta, force, error, equilibria, newton_iterations}

## Studies
study.base: the scene that is varied: the path of its file, or the scene itself
set: keys and values that hold for every run
vary: keys and the values they take: lists or ranges, crossed or zipped
cases: scenes of their own instead of base and vary: {name, scene, set, published, exact}
zip: which keys go together value by value: true, or a list of them
compare_to: what force, a and p_max are compared with: theory, finest, a force, a result
tolerance [1]: error of the force that is still right: every row gets a verdict, refused scenes a row
from [that of the key]: first number of a range
to [that of the key]: last number of a range
count [1]: how many numbers a range has, both ends included
spacing: linear: equal distances; log: equal factors
unit: E*/h_contact: the numbers of the range are multiples of it, on each mesh its own

## Table of a study, one row a run
index [1]: number of the row, from 1, in the order of the grid
run: name of the run's folder: equal physics has equal names and is solved once
status: done, failed, or pending when the study was stopped before
exit_code [1]: what `indent-sim run` of this row would end with
steps_done [1]: requested depths that were reached
force_error_vs [1]: force / reference - 1 at the last depth; out of contact force / largest force
force_error_worst [1]: largest |force / reference - 1| at any depth of the path
a_error_vs [1]: a / reference - 1 at the last depth
p_error_vs [1]: p_max / reference - 1 at the last depth
reference: what the row is compared with: the run of the finest mesh, theory, a force or a result
study.stiffness [1]: epsilon_n or gamma of the method in E*/h_contact
dofs [1]: unknowns of the finite-element model
cpu_resolve [s]: CPU seconds until everything is decided
cpu_companions [s]: CPU seconds of the coarser mesh behind error bars, where there are any
cpu_mesh [s]: CPU seconds of the mesh
cpu_assemble [s]: CPU seconds of forms, matrices and factorisation
cpu_solve [s]: CPU seconds of all load steps
cpu_write [s]: CPU seconds of writing results
cpu_s [s]: CPU seconds of the run; loading the libraries is left out
stated_error [1]: relative error of the force that the run itself warns of or measures
warnings: what the run warns of
verdict: right, flagged, refused, wrong or reference; only with a tolerance
memory_MB [MB]: memory the run needed beyond what its process held before
peak_memory_MB [MB]: largest memory of the process during the run, and of the one that meshes

## Scoreboard of a study, one row a published value
case: name of the case
quantity: column that the value is of, or pull_off
published [that of the quantity]: the value that a source states
exact [that of the quantity]: the exact value
exact_by: the second method that it is known by: a theory of the same body, another run, a closed form
ours [that of the quantity]: what the run found
our_error [that of the quantity]: half-width of its error bar
difference [1]: published over exact, less one, in per cent
claims: what the source says that its value is: exact, fit, elements
source: where the value is published
within [1]: how far off it may be by the source's own account; empty where it says nothing
ours_difference [1]: ours over exact, less one, in per cent
wrong: who is off by more than is claimed: nobody, published, ours, both, or unknown

## Table of a fit, one row a curve
curve: name of the measured curve: its file's, with a number where the file has several
fit.reason: why a curve has no parameters
explained: whether nothing in the curve stands against the scene: residuals, windows, baseline, other models
cause: what does: thickness, adhesion, relaxation, tip (another model is better), shape, window, baseline
contact_point [length]: where the tip touches first, on the file's own scale of depths or ways
contact_point_low [length]: lower end of its 95 % interval
contact_point_high [length]: upper end of its 95 % interval
force_max [force]: largest force of the fit, its baseline taken off
fit.depth [length]: of the deepest sample, from first touch
rms_percent [1]: root of the mean square residual, in per cent of force_max
fit.n [1]: samples that were fitted, means of neighbours where a file has more than 1500
n_effective [1]: samples without correlation that tell as much
drift_percent [1]: first varied key at half the depth over that at the whole, less one, in per cent
hertz_E [pressure]: modulus that a half-space fit from the same contact point reads

## Contact surface
x [length] $x$: undeformed position along x; along the radius in an axisymmetric scene
y [length] $y$: undeformed position along y; 0 in a scene with two dimensions
u [length] $u$: displacement
z [length] $z$: height of the undeformed point, 0 on a flat top; of a row the way of the cantilever's base,
  delta + force/k + c force
u_x [length] $u_x$: displacement along x; along the radius in an axisymmetric scene
u_y [length] $u_y$: displacement along y
u_z [length] $u_z$: displacement along z, < 0 under the tip
gap [length] $g$: distance of the body from the tip, >= 0 open
pressure [pressure] $p$: contact pressure >= 0
shear [pressure] $\tau$: tangential traction on the body, > 0 along x or the radius; its size where there are three
  dimensions; with friction

## Continuum mechanics
H [1] $H$: displacement gradient
F [1] $F$: deformation gradient I + H
C [1] $C$: right Cauchy-Green tensor F^T F
J [1] $J$: volume ratio det F
P [pressure] $P$: first Piola-Kirchhoff stress
S [pressure] $S$: second Piola-Kirchhoff stress
sigma [pressure] $\sigma$: Cauchy stress
psi [pressure] $\psi$: strain energy per undeformed volume
v [length] $v$: virtual displacement
n [1] $n$: outward normal
"""

_ENTRY_PATTERN = re.compile(
    r"(?P<name>\S+?)( \[(?P<dimension>[^]]+)\])?( \$(?P<latex>[^$]+)\$)?: (?P<meaning>.+)"
)


def _parse_entry(text: str) -> Symbol:
    match = _ENTRY_PATTERN.fullmatch(" ".join(text.split()))
    assert match, text
    return Symbol(
        match["name"], match["meaning"], match["dimension"] or WORD_DIMENSION, match["latex"] or ""
    )


def _parse_groups() -> dict[str, tuple[Symbol, ...]]:
    """The entries of the glossary by the headings of their groups."""
    groups = (group.strip().split("\n", 1) for group in GLOSSARY.split("## ")[1:])
    return {
        title: tuple(map(_parse_entry, re.split(r"\n(?! )", entries))) for title, entries in groups
    }


GROUPS = _parse_groups()
ADHESION_SYMBOLS = GROUPS["What is known of an attraction over a range"]
SYMBOLS = {symbol.name: symbol for group in GROUPS.values() for symbol in group}
PULL_OFF = (SYMBOLS["maugis_pull_off"], SYMBOLS["jkr_pull_off"])


def lookup(name: str, section: str = "") -> Symbol | None:
    """The entry of a name, the section's own before the general one; None when it has none."""
    return SYMBOLS.get(f"{section}.{name}") or SYMBOLS.get(name)
