"""MuJoCo's flexible sheets."""

from typing import Any, ClassVar

import numpy as np

from warpdeform.study.peers.engine import Engine, Session, Setting
from warpdeform.study.peers.sheet import FPS, Array, Sheet

EXAMPLE_STEP = 0.002
"""Step of MuJoCo's own cloth on a sphere (model/flex/drape.xml) [s]."""


class MuJoCo(Engine):
    """A two-dimensional flex of MuJoCo under its `discrete` integrator.

    Its membrane is Saint Venant-Kirchhoff in plane stress and its bending stiffness E t^3 / (12 (1 - nu^2)), so Young's
    modulus and thickness follow from Eh and D. Node masses go by area. Double precision, no damping, and the
    example's solver: CG, tolerance 1e-6, at most 400 iterations. The example's step of 2 ms is rounded to 9 steps a
    frame. The references integrate the same forces explicitly.
    """

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    law: ClassVar[str] = "Saint Venant-Kirchhoff triangles, hinges"

    def settings(self, nodes: int) -> tuple[Setting, ...]:
        """The example's step, longer and shorter ones."""
        example = int(np.ceil(1.0 / (FPS * EXAMPLE_STEP)))
        return tuple(
            Setting(f"dt 1/{FPS * k}", {"substeps": k, "integrator": "discrete"}, example=k == example)
            for k in (1, 2, 4, example, 18, 36)
        )

    def references(self, nodes: int) -> tuple[Setting, Setting]:
        """Semi-implicit Euler at a third of the longest stable step, and two thirds."""
        substeps = Sheet(nodes).explicit_substeps(2 / 3)
        fine, coarse = ({"substeps": k * substeps, "integrator": "Euler"} for k in (2, 1))
        return Setting("explicit steps", fine), Setting("explicit steps, twice as long", coarse)

    def prepare(self, sheet: Sheet, setting: Setting) -> Session:
        """Compile the model."""
        return _Flex(sheet, setting.values["substeps"], setting.values["integrator"])


class _Flex(Session):
    def __init__(self, sheet: Sheet, substeps: int, integrator: str) -> None:
        import mujoco

        self._shape = (sheet.nodes, sheet.nodes, 3)
        self._substeps, self._step = substeps, mujoco.mj_step
        self._model = mujoco.MjModel.from_xml_string(_xml(sheet, 1.0 / (FPS * substeps), integrator))
        self._data: Any = mujoco.MjData(self._model)
        self._spread_mass(sheet)
        mujoco.mj_setConst(self._model, self._data)
        if integrator == "Euler":  # half a step back, so that its steps are Verlet's, of second order
            self._data.qvel[2::3] = 0.5 * sheet.gravity / (FPS * substeps)
        self._place = mujoco.mj_kinematics, mujoco.mj_flex

    def _spread_mass(self, sheet: Sheet) -> None:
        """Node masses by area: a flex shares its mass out equally, which makes its rim twice as heavy."""
        model, masses = self._model, sheet.masses().ravel()
        for k, body in enumerate(model.flex_vertbodyid):
            if body:  # pinned vertices belong to the world
                model.body_inertia[body] *= masses[k] / model.body_mass[body]
                model.body_mass[body] = masses[k]

    def advance_frame(self) -> None:
        self._step(self._model, self._data, self._substeps)

    def positions(self) -> Array:
        for place in self._place:  # a step leaves the vertices where it began
            place(self._model, self._data)
        return np.array(self._data.flexvert_xpos).reshape(self._shape)


def _xml(sheet: Sheet, dt: float, integrator: str) -> str:
    stiffness, nu, h = sheet.membrane_stiffness, sheet.poisson_ratio, sheet.spacing
    thickness = float(np.sqrt(12 * (1 - nu**2) * sheet.bending_stiffness / stiffness))
    mass = sheet.areal_density * sheet.side**2
    pins = " ".join(str(k) for k in sheet.pinned())
    return f"""<mujoco>
  <option timestep="{dt!r}" gravity="0 0 {-sheet.gravity}" integrator="{integrator}"
          solver="CG" tolerance="1e-6" iterations="400"/>
  <size memory="1G"/>
  <worldbody>
    <flexcomp name="sheet" type="grid" dim="2" count="{sheet.nodes} {sheet.nodes} 1" spacing="{h!r} {h!r} {h!r}"
              pos="0 {sheet.side / 2} 0" mass="{mass!r}" radius="{0.1 * h!r}">
      <edge equality="false"/>
      <elasticity young="{stiffness / thickness!r}" poisson="{nu}" thickness="{thickness!r}" elastic2d="both"/>
      <contact contype="0" conaffinity="0" selfcollide="none"/>
      <pin id="{pins}"/>
    </flexcomp>
  </worldbody>
</mujoco>"""
