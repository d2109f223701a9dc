"""The settings that are compared, and their names."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from warpdeform.integrators import INTEGRATORS
from warpdeform.linear import PRECONDITIONERS
from warpdeform.settings import Settings

TIGHT: dict[str, Any] = {
    "newton_iterations": 0, "newton_tolerance": 1e-6, "cg_tolerance": 1e-6, "cg_iterations": 5000,
    "precision": "float64", "time_step": "auto",
}  # fmt: skip
"""Nothing but the time step makes an error."""
CONVERGED: dict[str, Any] = {"newton_iterations": 0, "cg_tolerance": 1e-3, "cg_iterations": 1000}
"""Newton to the tolerance that is ordinary; a coarser linear solve takes more iterations, not more error."""
PAPER = ("terzopoulos", "terzopoulos-exact")
"""Methods that solve one linear system a step, and are stable where explicit ones are or nearly so."""
SUBSTEPS = (1, 2, 4, 8)
NEWTON = (1, 2, 0)
CG_TOLERANCES = (1e-1, 1e-3, 1e-4)
CG_CAPS = (5, 10, 20, 50)
TIME_TOLERANCES = (1e-3, 3e-4, 1e-4, 1e-5)
"""Of adaptive steps, over the size of the body."""
REFINED: tuple[dict[str, Any], ...] = (
    {"cg_tolerance": 1e-1},
    {"cg_tolerance": 3e-2},
    {"cg_tolerance": 1e-3},
    {"precision": "float64"},
)
"""What is tried of each implicit setting on the front."""


@dataclass(frozen=True)
class Setting:
    """Values of the solver's settings that differ from the scene's.

    Attributes:
        values: The values.
        grid: Cells along each axis over those of the scene.
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    grid: float = 1.0

    def over(self, settings: Settings) -> dict[str, Any]:
        """All solver settings that matter to speed or accuracy."""
        keys = (
            "integrator", "substeps", "time_step", "time_tolerance", "newton_iterations", "newton_tolerance",
            "cg_tolerance", "cg_iterations", "preconditioner", "precision",
        )  # fmt: skip
        return {key: self.values.get(key, getattr(settings, key)) for key in keys}

    def name(self, settings: Settings) -> str:
        """In the words of the scene file, shortened; what is as in the scene is left out but for the essentials."""
        every = self.over(settings)
        method = INTEGRATORS[every["integrator"]]
        words = [every["integrator"]]
        if every["time_step"] == "adaptive":
            words.append(f"steps to {every['time_tolerance']:.0e} m")
        else:
            words.append(f"{every['substeps']} a frame" + (" or more" if method.explicit else ""))
        if not method.explicit:
            newton = getattr(method, "iterations", None)
            newton = every["newton_iterations"] if newton is None else newton
            if every["integrator"] not in PAPER:
                words.append(f"Newton {newton or 'converged'}")
            words.append(f"CG {every['cg_tolerance']:.0e}")
            if every["cg_iterations"] < 100:
                words.append(f"at most {every['cg_iterations']}")
            if every["preconditioner"] != settings.preconditioner:
                words.append(every["preconditioner"])
        if every["precision"] != settings.precision:
            words.append(every["precision"])
        if self.grid != 1.0:
            words.append(f"grid x {self.grid:g}")
        return ", ".join(words)


def sweep(needed: int, size: float) -> Iterator[Setting]:
    """The ladder of methods, steps and Newton iterations, and each other knob by itself around the scene's settings.

    Args:
        needed: Steps a frame that explicit methods need.
        size: Size of the body [m].
    """
    yield Setting()
    for name, method in INTEGRATORS.items():
        if method.explicit:
            yield from (Setting({"integrator": name, "substeps": k * needed}) for k in (1, 2, 4))
        elif name in PAPER:
            counts = sorted({max(needed // 2, 1), needed, 2 * needed})
            yield from (Setting({"integrator": name, "substeps": k}) for k in counts)
        else:
            own = getattr(method, "iterations", None)
            for newton in NEWTON if own is None else (own,):
                values = {"integrator": name, **(CONVERGED if newton == 0 else {"newton_iterations": newton})}
                yield from (Setting({**values, "substeps": k}) for k in SUBSTEPS)
    for name in ("bdf2", "tr-bdf2"):
        double = {"integrator": name, "newton_iterations": 2, "precision": "float64"}
        yield from (Setting({**double, "substeps": k}) for k in SUBSTEPS)
    for name, newton in (("bdf2", 1), ("tr-bdf2", 2)):
        for tolerance in TIME_TOLERANCES:
            values = {"integrator": name, "newton_iterations": newton, "time_step": "adaptive"}
            yield Setting({**values, "time_tolerance": tolerance * size})
    yield from around()


def around() -> Iterator[Setting]:
    """Each other knob by itself, the rest as in the scene."""
    yield from (Setting({"cg_tolerance": tolerance}) for tolerance in CG_TOLERANCES)
    yield from (Setting({"cg_iterations": cap}) for cap in CG_CAPS)
    yield from (Setting({"preconditioner": name}) for name in PRECONDITIONERS)
    yield from (Setting({"precision": precision}) for precision in ("float32", "float64"))
    yield from (Setting({}, grid) for grid in (0.25, 0.5))


def refined(front: Sequence[Setting], settings: Settings) -> Iterator[Setting]:
    """Coarser and finer linear solves of the implicit settings on the front."""
    for setting in front:
        if not INTEGRATORS[setting.over(settings)["integrator"]].explicit:
            yield from (Setting({**setting.values, **values}, setting.grid) for values in REFINED)
