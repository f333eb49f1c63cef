"""Random scenes of soft tips, bodies that rest unbonded, and tips that are tilted or slide."""

from __future__ import annotations

from typing import Any

import numpy as np

Mapping = dict[str, Any]
KINDS = (
    "soft tips",
    "resting bodies",
    "two rubbers",
    "tilted tips",
    "tilted tips in 3D",
    "sliding tips",
)
POISSON_RATIOS = (0.0, 0.2, 0.3, 0.4, 0.45, 0.49, 0.5)


def contact_scenes(count: int, seed: int, kind: str) -> list[Mapping]:
    """Return random scenes of one of the KINDS, without their `output`."""
    drawn = Drawn(seed)
    draw = {
        "soft tips": drawn.soft_tip,
        "resting bodies": drawn.resting_body,
        "two rubbers": drawn.two_rubbers,
        "tilted tips": drawn.tilted_tip,
        "tilted tips in 3D": drawn.tilted_tip_in_3d,
        "sliding tips": drawn.sliding_tip,
    }[kind]
    return [draw() for _ in range(count)]


class Drawn:
    """Random scenes from a seed. Heights and moduli of the bodies are of the order of 1."""

    def __init__(self, seed: int):
        self.generator = np.random.default_rng(seed)

    def spread(self, low: float, high: float) -> float:
        """Return a number whose logarithm is uniformly distributed."""
        return float(np.exp(self.uniform(np.log(low), np.log(high))))

    def uniform(self, low: float, high: float) -> float:
        """Return a uniformly distributed number."""
        return float(self.generator.uniform(low, high))

    def either(self, *choices: Any) -> Any:
        """Return one of the choices."""
        return choices[int(self.generator.integers(len(choices)))]

    def is_true(self, probability: float) -> bool:
        """Return whether an event of this probability happens."""
        return bool(self.generator.random() < probability)

    def elastic(self, E: float = 1.0) -> Mapping:
        """Return a linear elastic law."""
        return {"model": "linear_elastic", "E": E, "nu": self.either(*POISSON_RATIOS)}

    def mesh(self, a: float, fewest: float, most: float) -> Mapping:
        """Return no section, or one with this number of elements in the contact radius a."""
        if self.is_true(0.4):
            return {}
        return {"mesh": {"h_contact": a / self.spread(fewest, most)}}

    def method(self) -> Mapping:
        """Return no section, or one with a contact method that condensed bodies have."""
        if self.is_true(0.6):
            return {}
        return {"contact": {"method": self.either("penalty", "active_set", "uzawa")}}

    def steps(self) -> int:
        """Return the number of steps of a load path."""
        return int(self.generator.integers(1, 6))

    # ---- two deformable bodies, and a body on a flat

    def soft_tip(self) -> Mapping:
        """Return a lens, punch or plate that is softer or stiffer than the body below."""
        a = self.spread(0.1, 0.4)
        R = self.spread(2.5, 6) * a
        shape = self.either("sphere", "sphere", "paraboloid", "paraboloid", "flat_punch", "plate")
        is_round = shape in ("sphere", "paraboloid")
        body, curvature = self.cap(R) if shape == "plate" else self.body_under_tip(R)
        tip: Mapping = {"shape": shape, "material": self.elastic(self.spread(0.1, 30))}
        if is_round:
            tip |= {"R": R, "thickness": self.uniform(0.5, 1.0) * R}
            depth = a * a * (1 / R + curvature)
        elif shape == "plate":
            tip |= {"radius": self.uniform(1.5, 2.5), "thickness": self.spread(0.3, 2)}
            depth = a * a * curvature
        else:
            tip |= {"radius": a, "thickness": self.spread(0.5, 5) * a}
            depth = 0.03 * a
        loading: Mapping = {"delta": depth, "steps": self.steps()}
        return (
            {"body": body, "material": self.elastic(), "indenter": tip, "loading": loading}
            | self.mesh(a, 4, 10)
            | self.method()
        )

    def body_under_tip(self, R: float) -> tuple[Mapping, float]:
        """Return a body, and the curvature of its top."""
        if self.is_true(0.25):
            return self.cap(R)
        base = self.either("fixed", "roller")
        sides = self.either("free", "roller")
        radius = self.uniform(1.5, 5)
        cylinder = {"shape": "cylinder", "radius": radius, "height": 1.0}
        return cylinder | {"base": base, "sides": sides}, 0.0

    def cap(self, R: float) -> tuple[Mapping, float]:
        """Return a cap of a ball whose radius is 1, and the curvature 1 of its top."""
        height = self.uniform(0.4, 1.0)
        base_radius = (1 - (1 - height) ** 2) ** 0.5
        return {"shape": "cap", "base_radius": base_radius, "height": height}, 1.0

    def resting_body(self) -> Mapping:
        """Return a ball or a cap on a flat under any tip, at a small strain."""
        height = self.uniform(0.3, 1.5)
        body: Mapping = {"shape": "ball", "radius": 1.0}
        if self.is_true(0.5):
            body = {"shape": "cap", "base_radius": 1.0, "height": height}
        R = self.spread(0.1, 10)
        shape = self.either("sphere", "paraboloid", "cone", "plate", "soft sphere")
        tip: Mapping = {"shape": shape}
        if shape in ("sphere", "paraboloid"):
            tip["R"] = R
        if shape == "cone":
            tip["half_angle"] = self.uniform(50, 80)
        if shape == "soft sphere":
            tip = {"shape": "sphere", "R": R, "material": self.elastic(self.spread(0.1, 10))}
        depth = min(self.spread(5e-4, 0.1), 0.1 * R, 0.1 * height)
        law = {"model": "linear_elastic", "E": 1.0, "nu": self.uniform(0.0, 0.495)}
        return {
            "body": body | {"base": "unbonded"},
            "material": law,
            "indenter": tip,
            "loading": {"delta": depth, "steps": self.steps()},
        } | self.method()

    def two_rubbers(self) -> Mapping:
        """Return a hyperelastic bead on a hyperelastic cap or layer, at finite strain."""
        R = self.spread(0.4, 1.5)
        body, curvature = self.body_under_tip(R)
        depth = self.spread(0.03, 0.2) * min(R, 1.0)
        a = (depth / (1 / R + curvature)) ** 0.5
        tip = {
            "shape": self.either("sphere", "sphere", "paraboloid"),
            "R": R,
            "thickness": self.uniform(0.6, 0.95) * R,
            "material": self.rubber(self.spread(0.2, 20)),
        }
        return {
            "body": body,
            "material": self.rubber(1.0),
            "indenter": tip,
            "loading": {"delta": depth, "steps": int(self.generator.integers(1, 4))},
            "mesh": {"h_contact": a / self.spread(3, 7)},
        }

    def rubber(self, E: float) -> Mapping:
        """Return a hyperelastic law with this Young's modulus at small strain."""
        nu = self.either(0.3, 0.4, 0.45, 0.49, 0.5)
        mu = E / (2 * (1 + nu))
        law = self.either(
            {"model": "neo_hookean", "E": E},
            {"model": "neo_hookean", "E": E},
            {"model": "mooney_rivlin", "C10": 0.35 * mu, "C01": 0.15 * mu},
            {"model": "gent", "mu": mu, "Jm": 30.0},
        )
        return law | {"nu": nu}

    # ---- tips that are tilted or slide

    def inclined_tip(self, a: float, slenderness: float) -> tuple[Mapping, float]:
        """Return a tilted tip, and a depth at which its contact radius is about a.

        The depth of a wedge or cone is `slenderness` times the height of its flank at a.
        """
        shape = self.either("cone", "cone", "paraboloid", "hyperboloid", "flat_punch")
        towards = self.either(0.0, 180.0)
        if shape == "flat_punch":
            tilt = self.spread(0.05, 2)
            tip = {"shape": shape, "radius": a, "tilt": tilt, "tilt_towards": towards}
            return tip, 0.02 * a + a * float(np.sin(np.radians(tilt)))
        if shape == "paraboloid":
            R = self.spread(2, 5) * a
            tip = {"shape": shape, "R": R, "tilt": self.uniform(2, 20), "tilt_towards": towards}
            return tip, a * a / R
        half_angle = self.uniform(68, 85)
        tilt = self.uniform(0.1, 0.7) * (90 - half_angle)
        tip = {"shape": shape, "half_angle": half_angle, "tilt": tilt, "tilt_towards": towards}
        if shape == "hyperboloid":
            tip["R"] = 0.3 * a
        if shape == "cone" and self.is_true(0.3):
            tip["tip_radius"] = 0.3 * a
        return tip, slenderness * a / float(np.tan(np.radians(half_angle)))

    def tilted_tip(self) -> Mapping:
        """Return a tilted tip on a strip in plane strain."""
        a = self.spread(0.05, 0.4)
        tip, depth = self.inclined_tip(a, 2.0)
        body = self.strip(a)
        material = self.elastic()
        if tip["shape"] != "flat_punch" and self.is_true(0.2):
            material = {"model": "neo_hookean", "E": 1.0, "nu": self.either(0.3, 0.45, 0.49)}
        loading = {"delta": depth, "steps": self.steps()}
        scene = {"body": body, "material": material, "indenter": tip, "loading": loading}
        return scene | self.mesh(a, 4, 10)

    def strip(self, a: float) -> Mapping:
        """Return a strip that is much wider than a contact with the half-width a."""
        return {
            "shape": "strip",
            "width": max(self.uniform(2, 8), 12 * a),
            "height": 1.0,
            "base": "fixed",
            "sides": self.either("free", "roller"),
        }

    def tilted_tip_in_3d(self) -> Mapping:
        """Return half of a box or cylinder under a tilted tip, with few elements."""
        a = self.spread(0.25, 0.5)
        tip, depth = self.inclined_tip(a, 1.2)
        width = self.uniform(1.4, 2.0)
        supports = {"base": "fixed", "sides": self.either("roller", "free")}
        body: Mapping = {"shape": "cylinder", "radius": width, "height": 1.0}
        if self.is_true(0.5):
            body = {"shape": "box", "size": [2 * width, 2 * width, 1.0]}
        return {
            "body": body | supports,
            "material": self.elastic(),
            "indenter": tip,
            "loading": {"delta": depth, "steps": int(self.generator.integers(1, 3))},
            "mesh": {"h_contact": a / self.uniform(2.5, 4), "symmetry": "half"},
        }

    def sliding_tip(self) -> Mapping:
        """Return a tip that slides back or forth on a strip, with partial or full slip.

        The depth or the force is held.
        """
        a = self.spread(0.02, 0.15)
        tip, depth = self.either(*self.upright_tips(a))
        friction = self.spread(0.05, 0.8)
        contact: Mapping = self.either(*[{"friction": friction}] * 4, {"friction": "stick"}, {})
        pressed: Mapping = {"delta": depth, "steps": self.steps()}
        if self.is_true(0.3):
            pressed = {"force": self.uniform(0.5, 1) * depth, "steps": self.steps()}
        reach = self.spread(0.3, 6) * friction * depth
        ends = [reach, -self.uniform(0.2, 1) * reach, reach][: int(self.generator.integers(1, 4))]
        slide = {"to": ends, "steps": int(self.generator.integers(2, 7))}
        return {
            "body": self.strip(a),
            "material": self.elastic(),
            "indenter": tip,
            "contact": contact,
            "loading": pressed | {"slide": slide},
            "mesh": {"h_contact": a / self.spread(5, 10)},
        }

    def upright_tips(self, a: float) -> list[tuple[Mapping, float]]:
        """Return tips, each with a depth at which its contact radius is about a."""
        half_angle = self.uniform(78, 86)
        slope = 1 / float(np.tan(np.radians(half_angle)))
        return [
            ({"shape": "paraboloid", "R": 1.0}, a * a),
            ({"shape": "sphere", "R": 1.0}, a * a),
            ({"shape": "cone", "half_angle": half_angle, "tip_radius": 0.2 * a}, 2 * a * slope),
            ({"shape": "cone", "half_angle": half_angle, "tilt": 2.0}, 2 * a * slope),
        ]

    def friction_loop(self, rows: int) -> Mapping:
        """Return a tip that slides to and fro once or twice at a held depth or force.

        The loops have partial or full slip, and `rows` rows in every stretch.
        """
        a = self.spread(0.03, 0.12)
        tip, depth = self.either(*self.upright_tips(a))
        friction = self.spread(0.05, 0.8)
        pressed: Mapping = {"delta": depth, "steps": 3}
        if self.is_true(0.4):
            pressed = {"force": self.uniform(0.5, 1) * depth, "steps": 3}
        # The tip slips as a whole from about twice friction * depth on.
        reach = self.spread(0.4, 6) * friction * depth
        ends = [reach, -reach] * self.either(1, 2) + [reach]
        return {
            "body": self.strip(a),
            "material": self.elastic(),
            "indenter": tip,
            "contact": {"friction": friction},
            "loading": pressed | {"slide": {"to": ends, "steps": rows}},
            "mesh": {"h_contact": a / self.spread(5, 8)},
        }
