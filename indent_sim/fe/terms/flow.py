"""Fluid in the pores of a body: Biot's equations, with the drained law's strain energy beside them.

The pressure p [pressure] of the fluid is counted from the bath's, p_b: above zero it pushes fluid
out. With the growth e of the volume (tr eps, at finite strain J - 1) and the content zeta = alpha e
+ storage (p + p_b) of fluid per undeformed volume, a stage of length dt that sets out from the
content zeta* adds

    int [ -alpha (p + p_b) e - storage (p + p_b)^2/2 + p zeta* - dt/2 grad p . m grad p ] dV  -
    dt/2 sum_i g_i p_i^2

to the potential: its slopes along u and p are equilibrium and the balance of fluid, zeta - zeta* =
dt div(m grad p). m is the mobility (at finite strain that of the step's begin), g_i the conductance
of the surface at a vertex i, so g_i p_i [length^3/time] flows out there. zeta* enters by its
integrals over the vertices' functions: what has left and what is there add up to round-off. Where
no time passes nothing flows, and the body is undrained.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body, Field, Moment, symbolic
from indent_sim.fe.observe.surface import barycentric, facet_nodes, heights_above
from indent_sim.fe.terms.contact.multiplier import sums
from indent_sim.fe.terms.term import GAMMA, Stage, Term
from indent_sim.mesh.modelled_part import Region
from indent_sim.model.body import Conductance
from indent_sim.scene.scene import Scene

NAME = "pore"
# Conductance of an open vertex in that of its own cells: p is 1e-8 of what it would be there.
# Forces are equal to 1e-7 from 1e6 on, and to 1e10 no digit is lost.
OPEN = 1e8
# What passes a vertex in a step in which the tip closes it, over what has passed it in the first
# stage of that step: it is taken to drain for half of the step. With the 1 + sqrt 2 of an open
# vertex the pore pressure had a spike of half the modulus in that row, and forces of a gel that
# swells against a sphere were up to 3 % too large, in steps a fourth of which leave 0.1 %. With
# half of the step they are within 1.4 % at all times: late rows are nearer (3 -> 0.9 %, 1 -> 0.2
# %), the early ones farther (0.4 -> 0.8 and 1.4 %). Measured on one scene alone,
# configs/swelling_gel.yaml, per_doubling 4 beside 16.
CLOSED_SHARE = 1 / (2 * GAMMA)


def fields(scene: Scene) -> list[Field]:
    """The pressure p of all permeable regions, continuous between them.

    A volume of fluid that is missing pushes what is around it: it is worth the stiffest region's E.
    """
    E = max(region.material.constants.E for region in scene.physics.part.regions)
    return [Field(NAME, 1, where=regions, weight=E)] if (regions := scene.physics.permeable) else []


class Flow(Term):
    """The fluid inside: what it does to the body, how much of it is where, and how it flows."""

    is_matter = True
    fields = (NAME,)
    has_memory = True
    flows = True

    def __init__(self, body: Body):
        self.body = body
        self._laws = {
            region: symbolic(region.material, body.mesh) for region in body.scene.physics.permeable
        }
        self._bath, self._bath_before = (
            {region: fem.Constant(body.mesh, 0.0) for region in self._laws} for _ in range(2)
        )
        self.is_constant = body.scene.physics.small_strain
        p = body.now.fields[NAME]
        now = body.now
        self.energy = sum(
            body.over_region(law.flow.storage * (p + self._bath[region]) ** 2 / 2, region)
            for region, law in self._laws.items()
        )
        self._content, self._content_before = (
            fem.form(self._over_vertices(moment, baths))
            for moment, baths in ((now, self._bath), (body.before, self._bath_before))
        )
        self._vector = compat.create_vector(self._content, body.unknowns.space)
        self._begin = self._start = self._one = np.zeros(
            body.unknowns.owned
        )  # int zeta of each vertex's function

    def _gradient(self, region: Region, moment: Moment) -> Expr:
        return self.body.scene.physics.part.kinematics.gradient(moment.fields["u"], self.body.X)

    def _over_vertices(self, moment: Moment, baths: dict[Region, fem.Constant]) -> ufl.Form:
        """int zeta of each vertex's function [length^3], a UFL form."""
        test = self.body.unknowns.of(self.body.now.test)[NAME]
        total = 0
        for region in self._laws:
            total += self.body.over_region(self._zeta(region, moment, baths) * test, region)
        return total

    def _zeta(self, region: Region, moment: Moment, baths: dict[Region, fem.Constant]) -> Expr:
        return self._laws[region].content(
            self._gradient(region, moment), moment.fields[NAME] + baths[region]
        )

    def potential(self, now: Moment, before: Moment, dt: fem.Constant) -> ufl.Form:
        """The share of a stage in the potential, but for p zeta*."""
        total = 0
        slope = self.body.scene.physics.part.kinematics.in_space(ufl.grad(now.fields[NAME]))
        for region, law in self._laws.items():
            H = self._gradient(region, now)
            p = now.fields[NAME] + self._bath[region]
            flux = ufl.dot(law.mobility(self._gradient(region, before)), slope)
            density = (
                -law.flow.alpha * p * law.growth(H)
                - law.flow.storage * p**2 / 2
                - dt / 2 * ufl.dot(slope, flux)
            )
            total += self.body.over_region(density, region)
        return total

    def work(self, now: Moment, before: Moment, dt: fem.Constant) -> ufl.Form:
        """Its slope along now.test, a UFL form."""
        return ufl.derivative(self.potential(now, before, dt), now.function, now.test)

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add the content that the stage sets out from to the rows of p."""
        b.array[:] += self._start

    def begin(self, stage: Stage) -> None:
        """Set out from the content of the last accepted state, and beyond it by what the first
        stage has changed.
        """
        self._take_baths(self._bath, self.body.now)
        if not stage.share:
            self._take_baths(self._bath_before, self.body.before)
            self._begin = self._one = self._assembled(self._content_before)
        self._start = self._begin + stage.share * (self._one - self._begin)

    def _take_baths(self, baths: dict[Region, fem.Constant], moment: Moment) -> None:
        for region, bath in baths.items():
            bath.value = self.body.scene.physics.bath_pressure(region, float(moment.t.value))

    def end(self, stage: Stage) -> None:
        """Keep the content of the stage's equilibrium."""
        self._one = self._assembled(self._content)

    def _assembled(self, form: fem.Form) -> np.ndarray:
        with self._vector.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(self._vector, form)
        self._vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return np.array(self._vector.array_r)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """p (facets, points) at reference-facet points of the contact surface [pressure], from the
        bath's.
        """
        space = self.body.unknowns.own_space(NAME)
        nodes = facet_nodes(self.body.mesh, space, self.body.body_mesh.surfaces["top"])
        return (
            self.body.local_array()[self.body.unknowns.places(NAME)[nodes]] @ barycentric(points).T
        )

    def largest(self) -> float:
        """The largest pressure [pressure] of this rank's vertices, from the bath's (collective).

        Where a film beside a drained face is thinner than the elements, p goes to and fro beside
        it: it is p (1 - (-0.268)^k) at the k-th vertex inside, 1.27 times what is right at the
        first. The mean F p of a vertex, weighted by its function, is right there, and 2 F p - F F p
        as well but for 1.1 at the first, while it differs from a smooth p by the fourth power of
        the elements alone.
        """
        mass, whole = self._mass
        p = mass.createVecRight()
        p.array[:] = self.body.local_array()[self.body.unknowns.places(NAME)[: len(p.array)]]
        once = mass * p
        once.pointwiseDivide(once, whole)
        twice = mass * once
        twice.pointwiseDivide(twice, whole)
        found = 2 * once.array_r - twice.array_r
        for vector in (p, once, twice):
            vector.destroy()
        return float(np.max(found[self._is_permeable], initial=-np.inf))

    @cached_property
    def _mass(self) -> tuple[PETSc.Mat, PETSc.Vec]:
        """The integrals of two vertices' functions, and of one; 1 at vertices outside of all
        permeable regions.
        """
        space = self.body.unknowns.own_space(NAME)
        product = ufl.TestFunction(space) * ufl.TrialFunction(space)
        mass = fem_petsc.assemble_matrix(
            fem.form(sum(self.body.over_region(product, region) for region in self._laws))
        )
        mass.assemble()
        ones = mass.createVecRight()
        ones.set(1.0)
        whole = mass * ones
        self._is_permeable = whole.array_r > 0
        whole.array[:] = np.where(self._is_permeable, whole.array_r, 1.0)
        return mass, whole

    def at_corners(self) -> np.ndarray:
        """p (cells, corners) of this rank's cells [pressure], from the bath's."""
        dofs = compat.cell_dofs(self.body.unknowns.own_space(NAME).dofmap)
        return self.body.local_array()[self.body.unknowns.places(NAME)[dofs]]

    def content_in(self, region: Region) -> Expr:
        """zeta [1] of a region, a UFL scalar; 0 without pores."""
        return (
            self._zeta(region, self.body.now, self._bath)
            if region in self._laws
            else ufl.as_ufl(0.0)
        )

    def pressure_in(self, region: Region) -> Expr:
        """alpha (p + p_b) [pressure], which the total stress has less than the drained law's; 0
        without pores.
        """
        if region not in self._laws:
            return ufl.as_ufl(0.0)
        return self._laws[region].flow.alpha * (self.body.now.fields[NAME] + self._bath[region])

    def content(self) -> np.ndarray:
        """Fluid at this rank's vertices beyond that at rest in a bath without pressure [length^3]."""
        return self._assembled(self._content)


class Valve(Term):
    """The surface of a body with fluid: a conductance at each vertex, which the tip changes where
    it touches.
    """

    has_memory = True

    def __init__(self, body: Body):
        self.body = body
        space = body.unknowns.own_space(NAME)
        drainage = body.scene.physics.drainage
        self._owned = space.dofmap.index_map.size_local
        self._places = body.unknowns.places(NAME)
        self._nodes = facet_nodes(body.mesh, space, body.body_mesh.surfaces["top"])
        self._open = OPEN * self._diagonal()
        top = np.isin(np.arange(len(self._places)), self._nodes)
        always = np.zeros(len(top))
        for name in body.scene.physics.drained_walls:
            always = np.maximum(always, self._on(name, "drained"))
        always = np.maximum(always, self._on("base", drainage.base))
        self._free, self._touched = (
            always + top * self._on("top", kind) for kind in (drainage.surface, drainage.tip)
        )
        self.follows_tip = drainage.surface != drainage.tip
        self._in_contact = fem.Function(space)  # 1 where the last accepted state touches the tip
        self._left = fem.Function(space)  # what has flowed out at each vertex since rest [length^3]
        self.history = (self._in_contact, self._left)
        self._touches = np.zeros(len(top), dtype=bool)
        self._visited = set[bytes]()
        self._leaves = np.zeros(self._owned)  # in the step to the present state [length^3]
        self.is_held = self._is_tried = False
        self._share = 0.0
        self._touched_before = self._touches
        self._leaves_before = self._leaves
        self.setting = 0

    def _diagonal(self) -> np.ndarray:
        """int k |grad|^2 of each vertex's function [length^3/(pressure time)]."""
        body = self.body
        space = self.body.unknowns.own_space(NAME)
        slopes = ufl.dot(ufl.grad(ufl.TestFunction(space)), ufl.grad(ufl.TrialFunction(space)))
        flows = [
            (region, flow)
            for region in body.scene.physics.permeable
            if (flow := region.material.flow)
        ]
        own = [(region, fem.Constant(body.mesh, flow.permeability)) for region, flow in flows]
        forms = [body.over_region(k * slopes, region) for region, k in own]
        matrix = fem_petsc.assemble_matrix(fem.form(sum(forms)))
        matrix.assemble()
        diagonal = np.zeros(len(self._places))
        diagonal[: self._owned] = matrix.getDiagonal().array_r
        matrix.destroy()
        return diagonal

    def _on(self, surface: str, kind: str | Conductance) -> np.ndarray:
        """The conductance of a surface at each vertex [length^3/(pressure time)]."""
        space = self.body.unknowns.own_space(NAME)
        if isinstance(kind, Conductance):
            area = fem_petsc.assemble_vector(
                fem.form(self.body.over_surface(surface, ufl.TestFunction(space)))
            )
            area.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            own = np.zeros(len(self._places))
            own[: self._owned] = kind.conductance * area.array_r
            return np.where(self._open > 0, own, 0.0)  # beside what is not permeable nothing flows
        nodes = facet_nodes(self.body.mesh, space, self._facets(surface))
        marks = sums(self.body.x, self._places[nodes], np.ones(nodes.shape))[self._places]
        return np.where((marks > 0) & (kind == "drained"), self._open, 0.0)

    def _facets(self, surface: str) -> np.ndarray:
        return self.body.body_mesh.surfaces.get(surface, np.empty(0, dtype=np.int32))

    def work(self, now: Moment, before: Moment, dt: fem.Constant) -> None:
        """None: a vertex is no form."""

    @property
    def _conductance(self) -> np.ndarray:
        return np.where(self._touches, self._touched, self._free)[: self._owned]

    @property
    def _outflow(self) -> np.ndarray:
        """g_i p_i of this rank's own vertices [length^3/time]."""
        return self._conductance * self.body.local_array()[self._places[: self._owned]]

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add -dt g_i p_i, but for what is taken back."""
        b.array[self._places[: self._owned]] -= (
            float(self.body.dt.value) * self._outflow - self._taken_back
        )

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add -dt g_i."""
        values = self._conductance
        dt = float(self.body.dt.value)
        for i in np.flatnonzero(values):
            place = self._places[i : i + 1].astype(np.int32)
            A.setValuesLocal(place, place, np.array([-dt * values[i]]), addv=PETSc.InsertMode.ADD)

    @property
    def _taken_back(self) -> np.ndarray:
        """What of the outflow of the first stage the second one extrapolates, at this rank's own
        vertices that the tip has closed in between: there it did not go on [length^3].
        """
        closed = (self._touches & ~self._touched_before)[: self._owned]
        return np.where(closed, (self._share - CLOSED_SHARE) * self._leaves_before, 0.0)

    def hold(self) -> None:
        """From here on all stages of a step, and all tries of it, have one contact: that of the
        last accepted state until `look` is told another.
        """
        self.is_held = True

    def begin(self, stage: Stage) -> None:
        """A step begins with the contact of the last accepted state."""
        self._share = stage.share
        self._touched_before = self._touches
        self._leaves_before = self._leaves
        if not stage.share:
            self._touched_before = np.ones_like(self._touches)
            self._leaves_before = 0.0 * self._leaves
        if self._is_tried:
            return
        if not stage.share:
            self._take(self._in_contact.x.array > 0.5)
        self._visited = {self._touches.tobytes()}
        self._is_tried = self.is_held

    def look(self, touching: np.ndarray) -> bool:
        """Take the corners (facets, corners) of the contact surface that touch the tip now; whether
        another equilibrium is to be found (collective). Not where they come back to what they
        were in this stage: then two sets exclude each other, by an element at the edge, and
        either will do.
        """
        if not self.follows_tip:
            return False
        touches = (
            sums(self.body.x, self._places[self._nodes], touching.astype(float))[self._places] > 0
        )
        is_new = self.body.comm.allreduce(touches.tobytes() not in self._visited, op=MPI.LOR)
        if is_new:
            self._take(touches)
            self._visited.add(touches.tobytes())
        return bool(is_new)

    def _take(self, touches: np.ndarray) -> None:
        self.setting += int(
            self.body.comm.allreduce(bool((touches != self._touches).any()), op=MPI.LOR)
        )
        self._touches = touches

    def end(self, stage: Stage) -> None:
        """Count what leaves: of the first of two stages by its share in the step."""
        self._leaves = (
            stage.share * self._leaves_before + stage.dt * self._outflow - self._taken_back
        )

    def accept(self) -> None:
        """The step is done: what has left and what touches is remembered."""
        self._left.x.array[: self._owned] += self._leaves
        self._in_contact.x.array[:] = self._touches
        self._is_tried = False

    def drained(self) -> np.ndarray:
        """What drained faces hold back while nothing flows: the table (vertices, 2) of all ranks,
        in one order, of the height of the elements at each vertex [length], and of p^2 times its
        area [pressure^2 length^2] of the part that is modelled (collective). A vertex that lets
        out less than its own cells let through holds no pressure at the face, and has no area.
        """
        body = self.body
        space = self.body.unknowns.own_space(NAME)
        places = np.asarray(
            space.dofmap.index_map.local_to_global(np.arange(len(self._places), dtype=np.int32))
        )
        heights = np.zeros(len(places))
        areas = np.zeros(len(places))
        drainage = body.scene.physics.drainage
        kinds = {"top": drainage.surface, "base": drainage.base}
        kinds |= dict.fromkeys(body.scene.physics.drained_walls, "drained")
        for surface in kinds:
            facets = self._facets(surface)
            area = fem_petsc.assemble_vector(
                fem.form(body.over_surface(surface, ufl.TestFunction(space)))
            )
            area.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            areas[: self._owned] += area.array_r
            area.destroy()
            nodes = facet_nodes(body.mesh, space, facets)
            above = np.repeat(heights_above(body.mesh, facets)[:, None], nodes.shape[1], axis=1)
            heights += sums(body.x, self._places[nodes], above)[self._places] / np.maximum(
                sums(body.x, self._places[nodes], np.ones(nodes.shape))[self._places], 1.0
            )
        p = body.local_array()[self._places[: self._owned]]
        lets = self._conductance > self._open[: self._owned] / OPEN
        mine = np.column_stack(
            [heights[: self._owned], np.where(lets, areas[: self._owned], 0.0) * p**2]
        )
        kept = areas[: self._owned] > 0
        parts = body.comm.allgather((places[: self._owned][kept], mine[kept]))
        table = np.concatenate([rows for _, rows in parts])
        return table[np.argsort(np.concatenate([numbers for numbers, _ in parts]), kind="stable")]

    def outflow(self) -> float:
        """What has left the body since rest [length^3], this rank's share."""
        is_on_the_way = float(self.body.now.t.value) != float(self.body.before.t.value)
        return float(self._left.x.array[: self._owned].sum() + is_on_the_way * self._leaves.sum())
