"""Symbols: the names of scene keys and result columns with meaning, dimension and LaTeX.

A name has the same meaning in YAML, Python and CSV. A key with a different meaning in one section
has an additional entry `section.key`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

# Dimension of a choice, a text or a switch.
WORD_DIMENSION = "word"


@dataclass(frozen=True)
class Symbol:
    """Name of a key or column with meaning, dimension and LaTeX symbol (may be empty)."""

    name: str
    meaning: str
    dimension: str = WORD_DIMENSION
    latex: str = ""


# Entries `name [dimension] $latex$: meaning` below the heading of their group; continuation lines
# are indented.
GLOSSARY = r"""
## Scene
title: title of the scene; printed on pictures
units: units of the numbers; a number that is given with another unit is converted
body: the soft body: its shape and its supports
material: the elastic law of the body, and of layers without a law of their own
indenter: the tip: an analytic surface, rigid unless it has a `material`
contact: the contact law and its enforcement
loading: the load path of the tip: the prescribed depths or forces
experiment: conditions of the measurement: adhesion without range, instrument, oscillations,
  calibration
map: thickness of the body at each pixel of a fitted map
mesh: element sizes, and the part of the body that is modelled
accuracy [1]: largest permitted relative error of the force at any step, from which the mesh is
  chosen; fast = 0.05, balanced = 0.01, accurate = 0.001
solver: solution of the equations
output: what is written, and where
units.length: label of the length unit, for example mm
units.force: label of the force unit, for example N

## Body
shape: shape of the body or tip, which determines the other keys of the section
radius [length] $r_0$: radius of the cylinder, of the ball, of the ellipsoid around its axis,
  of the flat punch, or of a soft plate
height [length] $h$: thickness of the body; it occupies -height <= z <= 0
width [length] $w$: width of the strip; it occupies 0 <= x <= width, in plane strain
base_radius [length] $b$: radius of the flat side on which a cap stands
contact_angle [degrees] $\theta$: contact angle of a cap, between base and curved surface; instead
  of `height`
size [length] $(l_x, l_y, l_z)$: edges of the box [0, l_x] x [0, l_y] x [-l_z, 0]
base: support of the lower face; roller: slides without friction, does not lift; unbonded (cap,
  ball, ellipsoid): rests on a rigid flat and may lift; for balls see docs/conventions.md
sides: support of the walls; roller: no normal displacement
surfaces.contact: name in the file of the surface that the tip may touch; default: the faces that
  face up
surfaces.base: name in the file of the surface that `base` supports; default: the level faces that
  face down
surfaces.sides: name in the file of the surface that `sides` supports; default: the vertical faces
x_min: support of the wall at x = 0
x_max: support of the wall at the largest x
y_min: support of the wall at y = 0
y_max: support of the wall at the largest y
layers: layers from the top, bonded to one another; their thicknesses add up to the height. Layers
  of a cap or ball are concentric coatings from the surface inwards, the last one is the core
thickness [length]: thickness of a layer; the last layer of a half_space (substrate) and of a cap or
  ball (core) has none
layers.material: material of the layer; default: `material` of the scene
surface_tension [energy/length^2] $\gamma$: surface tension of the contact surface, inside and
  outside the contact, a force per length; a curved body is in equilibrium with it before it is
  indented
inclusions: regions of another material, each inside one layer and bonded to it
inclusions.center [length]: center of the inclusion, [x, y, z]; y = 0 in a strip
inclusions.radius [length]: radius of the ball, or of the upright cylinder
inclusions.height [length]: height of the upright cylinder
inclusions.semi_axes [length]: semi-axes of the ellipsoid along x, y and z; in a strip it is
  infinite along y
inclusions.size [length]: edges of the box along x, y and z; in a strip it is infinite along y
inclusions.material: material of the inclusion
file: mesh of the body, a .msh, .xdmf, .vtu or .inp file in the scene's folder or below
kinematics: type of the mesh in the file: a section of triangles, or a body of tetrahedra
surfaces: names in the file of the surface that the tip may touch (`contact`), of the `base` and of
  the `sides`; without names they are recognized by their orientation; all other faces are free
regions: materials of the named regions of the file; all other cells have `material`
hash: hash of the mesh that the file must contain; every result states the hash of its mesh

## Material
model: the elastic law, which determines the other keys of `material`
E [pressure] $E$: Young's modulus
nu [1] $\nu$: Poisson's ratio
E_z [pressure] $E_z$: Young's modulus along the axis z of a transversely isotropic material, whose E
  and nu hold in the plane across it
nu_z [1] $\nu_z$: Poisson's ratio -eps_plane/eps_z under sigma_z of a transversely isotropic
  material
G_z [pressure] $G_z$: shear modulus of planes through the axis z of a transversely isotropic
  material
mu [pressure] $\mu$: shear modulus (never a friction coefficient)
kappa [pressure] $\kappa$: bulk modulus
C10 [pressure] $C_{10}$: coefficient of I1 - 3 (Mooney-Rivlin, Yeoh)
C01 [pressure] $C_{01}$: coefficient of I2 - 3 (Mooney-Rivlin)
C20 [pressure] $C_{20}$: coefficient of (I1 - 3)^2 (Yeoh)
C30 [pressure] $C_{30}$: coefficient of (I1 - 3)^3 (Yeoh)
alpha [1] $\alpha_i$: exponents of the stretches (Ogden)
Jm [1] $J_m$: limit of I1 - 3 (Gent)
b [1] $b$: rate at which the stiffness increases with I1 - 3, as exp(b (I1 - 3)) (Fung)
lambda_m [1] $\lambda_m$: limiting chain stretch (Arruda-Boyce)
G [pressure] $G$: shear modulus N kT of the dry network of N chains per volume (gel)
n_omega [1] $N\Omega$: chains per volume times the volume of a solvent molecule (gel)
chi [1] $\chi$: Flory's parameter of network and solvent (gel)
stretch [1] $\lambda_0$: free-swelling stretch of the undeformed gel relative to the dry network;
  auto: the stretch in the first bath
lame_lambda [pressure] $\lambda$: first Lamé constant, kappa - 2 mu / 3
flow: fluid in the pores; the elastic law has the drained constants, and the instantaneous response
  is undrained
permeability [length^2/(pressure time)] $k$: permeability of the pores divided by the viscosity of
  the fluid; at finite strain in the deformed body
diffusivity [length^2/time] $D$: diffusivity of the pore pressure in the confined body,
  permeability/(storage + alpha^2/M_c); instead of `permeability`; for a gel the diffusivity of the
  solvent
flow.alpha [1] $\alpha$: Biot's coefficient: fluid taken up per change of volume; 1: incompressible
  grains
material.storage [1/pressure] $S$: specific storage of the flow
flow.storage [1/pressure] $S$: specific storage: fluid taken up per pressure at constant volume; 0:
  incompressible grains and fluid
holmes_mow: permeability that decreases under compression, by the factor ((J - phi0)/(1 -
  phi0))^alpha exp(M (J^2 - 1)/2)
phi0 [1] $\phi_0$: volume fraction of the solid in the undeformed body
holmes_mow.alpha [1] $\alpha$: exponent of the porosity in the permeability
M [1] $M$: exponential rate at which the permeability falls with the volume
formulation: displacement alone, or mixed with a pressure for nu near 0.5
relaxation: decay of the modulus with time; the constants of the law are the instantaneous ones
prony [1, time] $[g_i, \tau_i]$: terms [fraction of the instantaneous modulus, time]; E(t) = E (1 -
  sum g_i (1 - exp(-t/tau_i)))
power_law: E(t) = E (t/time)^-exponent
of: which moduli relax: all alike at constant nu, or shear alone at constant bulk modulus
exponent [1] $b$: exponent of the power law, between 0 (elastic) and 1 (a liquid)
time [time] $t_0$: time at which the modulus of the power law is `material.E`
plasticity: von Mises yield with isotropic hardening, of a metal or a glass
yield_stress [pressure] $\sigma_y$: yield stress in uniaxial tension before any plastic strain
hardening: growth of the yield stress with the equivalent plastic strain alpha, by one law
hardening.n [1] $n$: exponent of power-law hardening, yield_stress (1 + E alpha/yield_stress)^n
hardening.linear [pressure]: hardening modulus: the yield stress grows by linear alpha
plasticity.n [1] $n$: short form of hardening: {n: ...}
plasticity.linear [pressure]: short form of hardening: {linear: ...}
plasticity.voce: short form of hardening: {voce: ...}
material.n [1] $n$: exponent of power-law hardening
material.linear [pressure]: hardening modulus of plasticity
voce: saturating hardening: the yield stress grows by rise (1 - exp(-alpha/strain))
rise [pressure]: largest growth of the yield stress
creep: plastic flow that depends on the rate: the flow stress is sigma(alpha) (1 + (alpha'/rate)^m)
  at the rate alpha' of the equivalent plastic strain; needs a load path in time
rate [1/time]: rate of the equivalent plastic strain at which the flow stress is twice that of slow
  loading
m [1] $m$: sensitivity of the overstress to the rate; small: nearly independent of time
strain [1]: equivalent plastic strain at which 63 % of the rise is reached
E_star [pressure] $E^*$: plane-strain modulus E / (1 - nu^2)

## Indenter
R [length] $R$: radius of the tip: of a sphere, or of a paraboloid or hyperboloid at its apex
half_angle [degrees] $\alpha$: angle between the axis and the flank (a pyramid: the face, a
  hyperboloid: the asymptote)
tip_radius [length] $\rho$: radius that rounds the apex (and a pyramid's edges, a profile's
  corners); 0: sharp
faces [1]: number of equal faces of the pyramid
rotation [degrees]: rotation of the pyramid about z; at 0 the normal of one face points along x
points [length] $(r_i, z_i)$: points [r, z] of the profile from the apex [0, 0] outwards, connected
  by straight lines
edge_radius [length] $\rho$: radius that rounds the edge of the flat punch; 0: sharp
indenter.material: law of a soft tip: linear elastic, or hyperelastic on a hyperelastic body; by
  default the tip is rigid
indenter.thickness [length]: thickness of a soft tip: distance from its lowest point to the rigid
  holder to which it is bonded, of a sphere or paraboloid at most R, by default R, half a ball
center [length] $(x_0, y_0)$: position of the tip's axis, [x, y], for a strip [x]; default: axis of
  the cylinder, middle of the box or strip. Of a tilted tip: of its lowest point, of a flat punch of
  the middle of its face
tilt [degrees] $\theta$: angle by which the tip's axis leans from the vertical; delta is the depth
  of the lowest point
tilt_towards [degrees]: horizontal direction to which the axis leans, from x

## Contact
method: contact algorithm; auto: the program chooses and reports the reason
epsilon_n [pressure/length] $\varepsilon_n$: normal contact stiffness; if the shear modulus relaxes,
  it decreases with E*
gamma [pressure/length] $\gamma$: stabilisation parameter of Nitsche's method
contact.gap: reference: gap at the undeformed point, pressure along z; current: gap at the deformed
  point, pressure along the tip's normal; auto: reference at small strain
lam [pressure] $\lambda_n$: contact multiplier, a pressure >= 0
p [pressure] $p$: normal contact pressure >= 0
friction [1] $f$: Coulomb's coefficient of friction, or stick: the surface never slips on the tip
tau [pressure] $\tau$: tangential traction on the body
epsilon_t [pressure/length] $\varepsilon_t$: tangential contact stiffness; auto: epsilon_n

## Loading
delta [length] $\delta$: indentation depth, > 0 into the body
loading.force [force] $F$: final force of the whole body, > 0 compressive; the depth is computed
steps [1]: number of equal steps to `delta` or `force`
deltas [length] $\delta_i$: sequence of depths instead of `delta`, also for unloading; < 0: the tip
  is clear of the body
forces [force] $F_i$: sequence of forces instead of `force`, also for unloading; 0: the tip just
  touches, at delta = 0, or where it loses contact with a body that has yielded
history [time, length]: depth over time as a list of points [t, delta]; with a cantilever or a frame
  [t, z]
force_history [time, force]: force over time as a list of points [t, force]
times [time] $t_i$: times of the rows of a history; auto: every point, and enough rows between them
  for a smooth curve
per_doubling [1]: number of time increments of equal length before the length doubles, in every
  segment of the history of a body that drains or whose shear modulus relaxes; default 4
loading.slide: sideways motion of the tip at the last depth or force, which is held
slide_history [time, length]: points [t, x] of the tip's horizontal displacement during a history of
  a body that relaxes in shear or drains
to [length] $x_i$: displacements to which the tip slides one after another, from where it was
  pressed in; one number is a scratch
slide.steps [1]: number of rows on each stretch of the slide
along [degrees]: direction of the slide, from x: 0 (x) or 90 (y)
loading.unload: unloading after the last depth or force
unload.to [length]: depth at which unloading ends unless contact is lost before; a force if forces
  are prescribed; 0: where the force has become zero
unload.rows [1]: number of rows of unloading
loading.rows [1]: number of rows of unloading

## Drainage
drainage: boundary conditions of the pore fluid, and its bath
drainage.surface: contact surface where the tip does not touch: drained or sealed
drainage.tip: contact surface where the tip touches: drained, sealed, or a conductance
drainage.base: lower face: drained, sealed, or a conductance
drainage.sides: walls: drained or sealed; auto: drained where they are free
bath [time, pressure] $p_b$: pressure of the fluid around the body, constant or as points [t,
  value], above its value in the undeformed body; for a gel the solvent's chemical potential over
  kT, 0 for the pure solvent
bath_ramp [time]: time in which a sudden change of the bath is imposed at a constant rate; auto:
  1/75 of the diffusion time of the contact, or of the height if that is shorter; 0 at small strain
conductance [length/(pressure time)] $X$: fluid flux out of the body divided by the pore pressure
  relative to the bath
pore_pressure [pressure] $p$: pressure of the fluid in the pores, relative to the bath
outflow [length^3]: fluid that has left the whole body since the undeformed state; < 0: fluid taken
  up
pore_pressure_max [pressure]: largest pore pressure, relative to the bath
tip_sink [length]: part of delta by which the lowest point of a soft tip is pressed in
tip_energy [energy]: part of the energy that is stored in a soft tip
a_base [length]: radius of the contact with the flat on which the body rests without a bond
base_approach [length]: part of delta by which the point at half of the height of such a body
  approaches the flat
drained: for an increment without duration of a body that drains: element height and p^2 times area
  at each vertex of a drained face; used only by the error estimate, not written to a file
moved [length^3]: volume of fluid that has moved, within the body or out of it
unbalanced [length^3]: error of the fluid balance; zero in equilibrium

## Experiment
adhesion: attraction of tip and body: in `contact` with a range, in `experiment` without one
work [energy/length^2] $w$: work of adhesion: the energy that separates a unit of area
base_work [energy/length^2] $w_b$: work of adhesion between a body that rests on a flat
  (`body.base: unbonded`) and the flat; `work` is that between tip and body
range [length]: gap over which the attraction falls by the factor e; in `experiment` it is used for
  the Tabor number alone
cantilever: cantilever spring that holds the tip
frame: compliance of the frame of the instrument
cantilever.stiffness [force/length] $k$: spring constant of the cantilever; in plane strain per unit
  length, a pressure
compliance [length/force] $c$: compliance of the frame; in plane strain times unit length
frequencies [1/time]: cycles per time of small oscillations about the end of the history, whose
  results are in dynamic.csv
calibration: relative uncertainties of the instrument
calibration.stiffness [1]: relative uncertainty of the cantilever's stiffness
calibration.R [1]: relative uncertainty of the tip's radius
t [time] $t$: time
branch: approach, hold or retract of a history; stable or unstable of an equilibrium curve
frequency [1/time]: cycles per time
storage [force/length] $K'$: in-phase stiffness of the contact
loss [force/length] $K''$: out-of-phase stiffness of the contact

## Mesh
h_contact [length] $h$: element size under the tip; auto: at most 0.3 % error of the force at the
  last step
h_axis [length]: element size at the tip's axis, from which sizes grow to h_contact at the edge of
  the largest contact; without it a given h_contact holds everywhere under the tip
h_edge [length]: element size at the sharp edge of a flat punch, and along all of a rounded edge
  with friction; default: a fraction of h_contact
h_corner [length]: element size at those corners of a two-dimensional model domain that affect the
  contact: where a fixed face meets a free face, at edges of cylindrical inclusions on the axis,
  and where the contact is close to a side; without
  it and with a given h_contact, corners are not refined
h_film [length]: element size at drained faces next to the contact, in a two-dimensional model
  domain; without it and with a given h_contact, these faces are not refined
h_inclusions [length]: element size inside each inclusion, in their order; default: chosen by the
  effect of each inclusion on the force
h_layers [length]: element size inside each coating of a cap or ball, from the outermost; default: a
  fraction of its thickness
grading [1]: growth of the element size per unit distance, outside the contact
h_far [length] $h_\infty$: largest element size, far from the tip
order [1]: polynomial order of the displacement; linear elements (1) were removed
refinements [1]: number of uniform refinements of a mesh from a file; default: as many as `accuracy`
  needs, or none
symmetry: part of the body that is modelled; auto: the smallest that the symmetry of the scene
  allows

## Solver
solver.method: theory (without a mesh), condensed (mesh condensed to the contact surface) or newton
  (whole mesh by Newton's method); auto: the program chooses and reports the reason
linear: solution of linear systems, by factorisation or iteratively; results differ by less than
  1e-8
rtol [1]: relative residual at which a step counts as converged; with more than 1e-9 a row could
  fail the check of the force against the reactions. At most 1e-10 with linear: iterative
max_iterations [1]: largest number of Newton iterations of one step

## Output
directory: result folder, below the working directory; default: results/ and the name of the config
fields: steps whose fields are written for ParaView; last: the deepest and the last; auto: last if a
  mesh is solved, none with theory
nodal_stress: whether the fields also contain the stress at the nodes: the volume-weighted mean over
  the adjacent cells of one region; at an interface each region has nodes of its own
surface: state of the contact surface, point by point
output.surface: steps whose contact surface is written to surface.csv; last: the deepest and the
  last
output.reactions: whether force_indentation.csv has a column for each reaction of a support
plot: whether force_indentation.png is drawn

## Results, one row a step
step [1]: number of the requested depth or force, from 1
force [force] $F$: contact force of the whole body, > 0 compressive; per unit length in plane strain
a [length] $a$: contact radius; half-width in plane strain; sqrt(area/pi) in 3D
p_max [pressure] $p_{\max}$: largest contact pressure; per undeformed area with gap: reference, per
  deformed area (true) with gap: current; empty where it is infinite
penetration [length]: largest penetration of the tip into the body at a contact point
energy [energy] $\Pi$: strain energy plus contact energy of the whole body
stiffness [force/length] $\mathrm{d}F/\mathrm{d}\delta$: slope of the load curve at this row
area [area]: contact area, pi a^2; in plane strain its width, 2 a
E_hertz [pressure]: modulus computed from this row by the half-space formula of the same tip; empty
  if there is no such formula
newton_iterations [1]: linear solves of the step, including its substeps
krylov_iterations [1]: Krylov iterations of these linear solves and of those for the stiffness; only
  with the iterative solver
wall_s [s]: wall time since the start of the run
stick_radius [length]: sqrt(area/pi) of the part of the contact that does not slip on the tip, with
  friction; in plane strain half its width
dissipation [energy]: energy dissipated by friction since the previous row; with friction
plastic_dissipation [energy]: energy dissipated by plastic flow since the undeformed state; with
  plasticity
hardness [pressure] $H$: force over contact area under load; with plasticity
contact_area [area] $A$: contact area under load; with plasticity, in place of area
unloading_stiffness [force/length] $S$: slope of the load curve if unloading began at this row; with
  plasticity, in place of stiffness
residual_depth [length] $h_r$: depth at which the force has become zero in unloading; in the last
  row, with loading.unload
side_force_x [force]: force on the tip along x; with friction, a slide, or a tilt and gap: current,
  if no mirror plane is normal to x; of a sliding tip with the force of the pressure on its slope
side_force_y [force]: force on the tip along y, as side_force_x
moment [force length] $M$: integral of pressure times distance from the tip's axis along
  `tilt_towards`, of an upright tip along its slide, > 0 if loaded more on that side; with a tilt or
  a slide
x_contact [length]: distance of the resultant force from the tip's axis, moment/force; with a tilt
  or a slide
force_error [force]: estimated error of the force: half-width of its interval
a_error [length]: estimated error of the contact radius: half-width of its interval
p_max_error [pressure]: estimated error of the largest pressure: half-width of its interval
delta_error [length]: estimated error of a depth that is computed for a force: half-width of its
  interval
residual_depth_error [length]: estimated error of the residual depth: half-width of its interval;
  with loading.unload
stick_radius_error [length]: estimated error of the stick radius: half-width of its interval; with
  friction
dissipation_error [energy]: estimated error of the dissipation: half-width of its interval; with
  friction
moment_error [force length]: estimated error of the moment: half-width of its interval; with a tilt
  or a slide
x_contact_error [length]: estimated error of x_contact: half-width of its interval; with a tilt or a
  slide
side_force_x_error [force]: estimated error of the side force: half-width of its interval
side_force_y_error [force]: estimated error of the side force: half-width of its interval
calibration_error [force]: uncertainty of the force from the calibration of the instrument; with a
  history
reaction [force]: z-reaction of all constrained degrees of freedom; equals the force
reactions [force]: force of each support on the body, by support and axis; of the whole body
intrusion [length]: penetration of the tip into a surface on which no contact is modelled
roughness [1]: amplitude of the pressure's oscillation from node to node, divided by its peak
clearance [length]: distance of the tip above the surface of a swelling or shrinking gel that it
  does not touch
overlap [length]: penetration of a whole surface facet into the tip; only with gap: current
stray_reaction [force]: reaction of the constraints that only prevent rigid motions; zero in
  equilibrium
lateral_imbalance [force]: horizontal forces on the body under a sliding tip that do not balance;
  zero in equilibrium
substeps [1]: number of increments into which the step was divided
converged: whether the step has a solution
reason: reason why a step has no solution

## Estimates for adhesion over a range
cohesive_zone [length]: width of the cohesive zone
elements [1]: number of elements in the cohesive zone
tabor [1]: Tabor number
maugis_lambda [1] $\lambda$: Maugis' lambda
maugis_pull_off [force]: pull-off force by Maugis-Dugdale on a half-space
jkr_pull_off [force]: pull-off force without range (JKR)

## Largest tensile force with adhesion over a range
largest_pull: row with the largest tensile force: {step, delta, force}
pull_off: largest tensile force between rows of unloading: {delta, force, error, equilibria,
  newton_iterations}

## Studies
study.base: the scene that is varied: the path of its file, or the scene itself
set: keys and values that are the same in every run
vary: varied keys, each with its values: a list or a range; keys are combined in all ways, or value
  by value (zip)
cases: scenes of their own instead of base and vary: {name, scene, set, published, exact}
sample: points of all ranges of vary together: {method: sobol or latin_hypercube, count, seed}
where: conditions between keys that every point must fulfil; the other points are left out
zip: keys that vary together value by value: true, or a list of them
compare_to: reference of force, a and p_max: theory, finest, a force, a result
tolerance [1]: largest error of the force that counts as correct; with it every row has a verdict,
  also rejected scenes
from [that of the key]: first number of a range
study.to [that of the key]: last number of a range
count [1]: number of values in a range, both ends included
spacing: linear: equal distances; log: equal factors
unit: E*/h_contact: the numbers of the range are multiples of it, for each mesh

## Table of a study, one row a run
index [1]: number of the row, from 1, in the order of the grid
run: name of the run's folder: equal scenes have equal names and are solved once
status: done, failed, or pending if the study was stopped before this run
exit_code [1]: exit code of `indent-sim run` for this row
steps_done [1]: number of requested depths that were reached
force_error_vs [1]: force / reference - 1 at the last depth; if the reference is 0, force / largest
  force of the run
force_error_worst [1]: largest |force / reference - 1| at any depth of the path
a_error_vs [1]: a / reference - 1 at the last depth
p_error_vs [1]: p_max / reference - 1 at the last depth
reference: what the row is compared with: the finest run, theory, a force or a result
study.stiffness [1]: epsilon_n or gamma of the method in E*/h_contact
dofs [1]: unknowns of the finite-element model
cpu_resolve [s]: CPU seconds for all decisions before the mesh
cpu_companions [s]: CPU seconds of the coarser run for error estimates, if there is one
cpu_mesh [s]: CPU seconds of the mesh
cpu_assemble [s]: CPU seconds of forms, matrices and factorisation
cpu_solve [s]: CPU seconds of all load steps
cpu_write [s]: CPU seconds of writing results
cpu_s [s]: CPU seconds of the run without loading libraries
stated_error [1]: relative error of the force that the run itself warns of or estimates
warnings: warnings of the run
verdict: right, flagged, refused, wrong or reference; only with a tolerance
memory_MB [MB]: memory that the run needed in addition to that of its process before the run
peak_memory_MB [MB]: largest memory of the process during the run plus that of the meshing process

## Published values of a study, one row a value
case: name of the case
quantity: column of the published value, or pull_off
published [that of the quantity]: the value that a source states
exact [that of the quantity]: the exact value
exact_by: second method by which the value is known: a theory of the same body, another run, a
  closed form
ours [that of the quantity]: value computed by the run
our_error [that of the quantity]: error estimate of the run: half-width of the interval
difference [1]: published over exact, minus one, in per cent
claims: what the source says about its value: exact, fit, elements
source: where the value is published
within [1]: deviation that the source itself states; empty if it states none
ours_difference [1]: ours over exact, minus one, in per cent
wrong: value that deviates by more than its stated error: nobody, published, ours, both, or unknown

## Fit of a map
map.thickness: height: the thickness of a pixel follows the height of the surface at zero force
map.mean [length]: median thickness of the body; body.height if it is not given
map.base: plane above which the surface has the thickness, instead of a median thickness
plane: fitted: through the pixels on the bare substrate

## Table of a fit, one row a curve
curve: name of the measured curve: name of the file, with a number if it has several curves
fit.reason: reason why a curve has no parameters
explained: true if the curve is consistent with the scene: random residuals, equal parameters from
  shallower depth ranges, no excess noise in contact, no significantly better alternative model
cause: likely reason if the scene does not explain the curve: thickness, adhesion, relaxation, tip
  (a model with this part is better), shape (trend of the residuals), window (dependence on the
  depth range), baseline (noise)
contact_point [length]: position of first contact, in the depths or positions of the file
contact_point_low [length]: lower end of the 95 % interval of the contact point
contact_point_high [length]: upper end of the 95 % interval of the contact point
force_max [force]: largest force of the fit, relative to the baseline
fit.depth [length]: depth of the deepest sample from first contact
rms_percent [1]: root of the mean square residual, in per cent of force_max
fit.n [1]: number of fitted samples; if the file has more than 1500, the fitted samples are means of
  neighbours
n_effective [1]: number of uncorrelated samples with the same information
drift_percent [1]: first varied key from a fit to half the depth over that from the fit to the whole
  depth, minus one, in per cent
hertz_E [pressure]: modulus of a half-space fit from the same contact point

## Contact surface
x [length] $x$: undeformed position along x; along the radius in an axisymmetric scene; in the force
  table the horizontal displacement of the tip from where it was pressed in, with loading.slide
y [length] $y$: undeformed position along y; 0 in a scene with two dimensions
u [length] $u$: displacement
z [length] $z$: height of the undeformed point, 0 on a flat top; in the force table the position of
  the cantilever's base, delta + force/k + c force
u_x [length] $u_x$: displacement along x; along the radius in an axisymmetric scene
u_y [length] $u_y$: displacement along y
u_z [length] $u_z$: displacement along z, < 0 under the tip
gap [length] $g$: distance of the body from the tip, >= 0 open
pressure [pressure] $p$: contact pressure >= 0
shear [pressure] $\tau$: tangential traction on the body, > 0 along x or the radius, its magnitude
  in three dimensions; with friction

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
    """Return the symbol of an entry `name [dimension] $latex$: meaning`."""
    match = _ENTRY_PATTERN.fullmatch(" ".join(text.split()))
    assert match, text
    return Symbol(
        match["name"], match["meaning"], match["dimension"] or WORD_DIMENSION, match["latex"] or ""
    )


def _parse_groups() -> dict[str, tuple[Symbol, ...]]:
    """Return the symbols of each group, keyed by the heading of the group."""
    groups = (group.strip().split("\n", 1) for group in GLOSSARY.split("## ")[1:])
    return {
        title: tuple(map(_parse_entry, re.split(r"\n(?! )", entries))) for title, entries in groups
    }


GROUPS = _parse_groups()
ADHESION_SYMBOLS = GROUPS["Estimates for adhesion over a range"]
SYMBOLS = {symbol.name: symbol for group in GROUPS.values() for symbol in group}
PULL_OFF = (SYMBOLS["maugis_pull_off"], SYMBOLS["jkr_pull_off"])


def lookup(name: str, section: str = "") -> Symbol | None:
    """Return the symbol of a name, preferably its entry for the section; None if unknown."""
    return SYMBOLS.get(f"{section}.{name}") or SYMBOLS.get(name)
