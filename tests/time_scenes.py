"""Random scenes in time: bodies that drain, relax in shear, or swell.

Their tips come, stay and go.
"""

from __future__ import annotations

from typing import Any

import numpy as np

KINDS = ("draining", "porous rubber", "relaxing", "relaxing rubber", "both", "gel")
QUIET = {"fields": "none", "surface": "none", "plot": False}
GEL_TIME = 31.05  # height^2/D_c of the gel below, times its solvent's diffusivity


class Drawn:
    """Random scenes from a seed."""

    def __init__(self, seed: int):
        self.draw = np.random.default_rng(seed)

    def spread(self, low: float, high: float) -> float:
        return float(np.exp(self.draw.uniform(np.log(low), np.log(high))))

    def either(self, *choices: Any, p: list[float] | None = None) -> Any:
        return choices[int(self.draw.choice(len(choices), p=p))]

    def scene(self, kind: str) -> dict[str, Any]:
        """A scene whose heights, moduli and characteristic time are of the order of 1."""
        if kind == "gel":
            return self._gel()
        is_rubber = "rubber" in kind
        a = self.spread(0.15, 0.4)
        body = self._body()
        tip, depth = self._tip(a)
        material = self._rubber(kind) if is_rubber else self._linear(kind)
        flows = "flow" in material
        tau = a * a if flows else 1.0  # D and the longest relaxation time are about 1
        loading = self._loading(depth, tau)
        found = {
            "body": body,
            "material": material,
            "indenter": tip,
            "loading": loading,
            "mesh": {"h_contact": a / float(self.draw.uniform(5, 8))},
            "output": QUIET,
        }
        if flows:
            found["drainage"] = self._drainage()
        if self.draw.random() < 0.15 and "force_history" not in loading:
            found["contact"] = {"friction": self.either(0.3, "stick")}
        return found

    def _body(self) -> dict[str, Any]:
        sides, base = (
            self.either("roller", "free", "fixed"),
            self.either("fixed", "roller", p=[0.7, 0.3]),
        )
        body: dict[str, Any] = {
            "shape": "cylinder",
            "radius": float(self.draw.uniform(1.5, 3)),
            "height": 1.0,
        }
        body |= {"base": base, "sides": sides}
        if self.draw.random() < 0.15:
            return self.either(
                {"shape": "half_space"}, {"shape": "layer", "height": 1.0, "base": base}
            )
        if self.draw.random() < 0.15:
            body = {"shape": "strip", "width": 4.0, "height": 1.0, "base": "fixed", "sides": sides}
        return body

    def _tip(self, a: float) -> tuple[dict[str, Any], float]:
        """A tip, and the depth at which its contact radius is about a."""
        shape = self.either("paraboloid", "sphere", "cone", p=[0.5, 0.3, 0.2])
        if shape == "cone":
            angle = float(self.draw.uniform(70, 85))
            return {"shape": shape, "half_angle": angle}, 1.57 * a / float(
                np.tan(np.radians(angle))
            )
        R = self.spread(1.5, 5) * a
        return {"shape": shape, "R": R}, a * a / R

    def _relaxation(self) -> dict[str, Any]:
        if self.draw.random() < 0.2:
            return {
                "power_law": {"exponent": float(self.draw.uniform(0.05, 0.3)), "time": 1.0},
                "of": "shear",
            }
        first = float(self.draw.uniform(0.1, 0.6))
        terms = [[first, self.spread(0.03, 1.0)]]
        if self.draw.random() < 0.5:
            terms.append([float(self.draw.uniform(0.05, 0.9 - first)), self.spread(0.03, 1.0)])
        return {"prony": terms, "of": "shear"}

    def _linear(self, kind: str) -> dict[str, Any]:
        nu = float(self.either(0.0, 0.2, 0.3, 0.4, 0.45))
        material = {"model": "linear_elastic", "E": 1.0, "nu": nu}
        if kind in ("draining", "both"):
            flow = {"diffusivity": self.spread(0.5, 2.0)}
            if self.draw.random() < 0.3:
                flow |= {
                    "alpha": float(self.draw.uniform(0.6, 1)),
                    "storage": float(self.draw.uniform(0, 1)),
                }
            material["flow"] = flow
        if kind in ("relaxing", "both"):
            material |= {"nu": nu if kind == "both" else float(self.either(nu, 0.49, 0.5))}
            material["relaxation"] = self._relaxation()
        return material

    def _rubber(self, kind: str) -> dict[str, Any]:
        nu = float(self.either(0.2, 0.3, 0.4))
        mu = 1 / (2 * (1 + nu))
        material = {"model": "mooney_rivlin", "C10": 0.4 * mu, "C01": 0.1 * mu, "nu": nu}
        if kind == "porous rubber":
            pores = {"phi0": 0.2, "alpha": 2.0, "M": 0.5} if self.draw.random() < 0.4 else None
            return material | {
                "flow": {"diffusivity": self.spread(0.5, 2)}
                | ({"holmes_mow": pores} if pores else {})
            }
        return material | {
            "nu": float(self.either(0.4, 0.49, 0.5)),
            "relaxation": self._relaxation(),
        }

    def _drainage(self) -> dict[str, Any]:
        return {
            "surface": self.either("drained", "drained", "sealed"),
            "tip": self.either(
                "sealed", "drained", {"conductance": self.spread(0.1, 10)}, p=[0.5, 0.3, 0.2]
            ),
            "base": self.either("sealed", "drained", p=[0.7, 0.3]),
        }

    def _loading(self, depth: float, tau: float) -> dict[str, Any]:
        """Ramp, hold, and perhaps a way back, with rows at times that matter."""
        ramp, hold = tau * self.spread(0.03, 30), tau * self.spread(0.3, 30)
        points = [[0.0, 0.0], [ramp, depth], [ramp + hold, depth]]
        if self.draw.random() < 0.3:
            points.append([ramp + hold + ramp, float(self.draw.uniform(0.3, 0.8)) * depth])
        end = points[-1][0]
        moments = {*np.linspace(0.3, 1, 4) * ramp, *(ramp + hold * np.geomspace(0.01, 1, 4)), end}
        found: dict[str, Any] = {
            "history": points,
            "times": sorted(float(min(t, end)) for t in moments),
        }
        found["times"] = sorted({*found["times"]})
        if self.draw.random() < 0.2:
            force = [[t, value / depth * 0.7 * depth**1.5] for t, value in points]
            return {"force_history": force, "times": found["times"]}
        return found

    def _gel(self) -> dict[str, Any]:
        G, chi = self.spread(0.3, 3), float(self.draw.uniform(0.3, 0.65))
        material = {"model": "gel", "G": G, "n_omega": self.spread(1e-3, 1e-2), "chi": chi}
        material |= {"stretch": float(self.draw.uniform(1.25, 1.6)), "flow": {"diffusivity": 1.0}}
        sides = self.either("roller", "free")
        body = {
            "shape": "cylinder",
            "radius": 2.0,
            "height": 1.0,
            "base": self.either("fixed", "roller"),
            "sides": sides,
        }
        kind = self.draw.random()
        tip, times = {"shape": "sphere", "R": 1.0}, [0.5, 2.0, 10.0, 60.0, 300.0]
        points = [[0.0, 0.0], [300.0, 0.0]]
        if kind < 0.4:
            depth = float(self.draw.uniform(0.03, 0.15))
            points = [[0.0, 0.0], [self.spread(0.3, 30), depth], [300.0, depth]]
        loading = (
            {"history": points, "times": times}
            if kind < 0.8
            else {"force_history": [[0.0, 0.0], [300.0, 0.0]]}
        )
        bath = {"bath": 0.0} if kind > 0.3 else {}
        auto = {} if bath else {"stretch": "auto"}
        if auto:
            bath = {"bath": -self.spread(1e-3, 3e-2)}
        return {
            "body": body,
            "material": material | auto,
            "indenter": tip,
            "loading": loading,
            "drainage": {"tip": self.either("sealed", "drained")} | bath,
            "mesh": {"h_contact": float(self.draw.uniform(0.06, 0.12))},
            "output": QUIET,
        }


def time_scenes(count: int, seed: int, kinds: tuple[str, ...] = KINDS) -> list[dict[str, Any]]:
    """Scenes of all kinds in turn."""
    drawn = Drawn(seed)
    return [drawn.scene(kinds[k % len(kinds)]) for k in range(count)]
