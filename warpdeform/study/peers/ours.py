"""This engine on the sheet of `hanging`."""

from pathlib import Path
from typing import ClassVar

from warpdeform.scene import Override, load_scene
from warpdeform.scene.play import simulation_of
from warpdeform.study.peers.engine import Engine, Session, Setting
from warpdeform.study.peers.sheet import FPS, Array, Sheet

TIMED_FROM = 256
"""Nodes along each side from which on only time is of interest: two settings, no errors."""
PRECONDITIONERS = ("auto",)
"""Preconditioners that are compared."""


class Ours(Engine):
    """warpdeform: BDF2, each step one or two Newton iterations of conjugate gradients; and Verlet.

    The material is the scene's own. Steps of 1/60 s and less, one or two Newton iterations, CG to 1e-2 or 1e-3. In
    single precision rounding grows to a millimetre by 0.5 s, so the shortest steps are in double precision. The
    scene's setting, two iterations a frame to 1e-2, counts as the example's. Verlet takes the steps that its bound on
    the largest frequency allows, in both precisions.
    """

    name: ClassVar[str] = "ours"
    package: ClassVar[str] = "warpdeform"
    law: ClassVar[str] = "Saint Venant-Kirchhoff membrane and quadratic curvature on the grid"

    def settings(self, nodes: int) -> tuple[Setting, ...]:
        """Steps of one frame to a 64th of it, the shortest in double precision, and Verlet; fewer for large sheets."""
        steps = [(1, 1, 1e-2, "float32"), (1, 2, 1e-2, "float32")]
        if nodes < TIMED_FROM:
            steps += [(s, k, 1e-2, "float32") for s in (2, 4, 8, 16) for k in (1, 2)]
            steps += [(16, 1, 1e-3, "float32"), (32, 1, 1e-3, "float64"), (64, 1, 1e-3, "float64")]
        precisions = ("float32", "float64") if nodes < TIMED_FROM else ()
        explicit = [Setting(f"Verlet, {p}", {"integrator": "verlet", "precision": p}) for p in precisions]
        return *(_setting(*step, name) for step in steps for name in PRECONDITIONERS), *explicit

    def references(self, nodes: int) -> tuple[Setting, Setting]:
        """Double precision, Newton to a millionth of the spacing, 256 and 128 steps a frame."""
        shared = {"newton_iterations": 0, "newton_tolerance": 1e-6, "cg_tolerance": 1e-3, "precision": "float64"}
        fine, coarse = ({"substeps": substeps, **shared} for substeps in (256, 128))
        return Setting("reference", fine), Setting("reference, twice the step", coarse)

    def prepare(self, sheet: Sheet, setting: Setting) -> Session:
        """Load the scene; compile and record its step."""
        return _Ours(sheet, setting)

    def sources(self) -> tuple[Path, ...]:
        """The law's kernels, too."""
        return *super().sources(), *sorted(Path(__file__).parents[2].glob("kernels/surface*.py"))


class _Ours(Session):
    def __init__(self, sheet: Sheet, setting: Setting) -> None:
        material = {
            "areal_density": sheet.areal_density,
            "membrane_stiffness": sheet.membrane_stiffness,
            "poisson_ratio": sheet.poisson_ratio,
            "bending_stiffness": sheet.bending_stiffness,
        }
        values = {
            "scene.fps": FPS,
            "scene.gravity": [0.0, 0.0, -sheet.gravity],
            "body.0.nodes": [sheet.nodes, sheet.nodes],
            "body.0.material": material,
            "body.0.position": [-0.5 * sheet.side, 0.0, 0.0],
            "solver.device": "cpu",
            **{f"solver.{key}": value for key, value in setting.values.items()},
        }
        self._simulation = simulation_of(load_scene("hanging", [Override(key, value) for key, value in values.items()]))

    def advance_frame(self) -> None:
        self._simulation.advance_frame()

    def positions(self) -> Array:
        return self._simulation.bodies[0].positions()


def _setting(substeps: int, newton: int, tolerance: float, precision: str, preconditioner: str) -> Setting:
    values = {
        "substeps": substeps,
        "newton_iterations": newton,
        "cg_tolerance": tolerance,
        "precision": precision,
        "preconditioner": preconditioner,
    }
    words = [f"dt 1/{FPS * substeps}", f"{newton} Newton", f"CG {tolerance:g}"]
    words += [word for word in (precision, preconditioner) if word not in ("float32", "auto")]
    return Setting(", ".join(words), values, example=(substeps, newton, precision) == (1, 2, "float32"))
