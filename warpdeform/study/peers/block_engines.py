"""The engines that drop a block: this one, MuJoCo's flex, Newton's vertex block descent."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from warpdeform.study.peers.block import Block
from warpdeform.study.peers.engine import Session, Setting
from warpdeform.study.peers.sheet import FPS, Array


@dataclass(frozen=True)
class BlockEngine:
    """An engine, and how it solves.

    Attributes:
        name: Its name.
        package: Distribution and module it comes from.
        settings: What is timed.
        prepare: Builds the block, compiles, records.
    """

    name: str
    package: str
    settings: tuple[Setting, ...]
    prepare: Callable[[Block, dict[str, Any]], Session]

    @property
    def missing(self) -> bool:
        """Whether it cannot be imported."""
        return find_spec(self.package) is None


class _Ours(Session):
    """BDF2 with steps of a frame, on the 18 strains of Saint Venant-Kirchhoff; the ground is an obstacle."""

    def __init__(self, block: Block, values: dict[str, Any]) -> None:
        import warpdeform as wd

        rubber = wd.Material(
            density=block.density, youngs_modulus=block.youngs_modulus, poisson_ratio=block.poisson_ratio
        )
        shape = wd.block((block.nodes,) * 3, size=(block.side,) * 3)
        body = wd.Body("block", shape, rubber, position=(0.0, 0.0, block.height))
        settings = wd.Settings(device="cpu", fps=FPS, gravity=(0.0, 0.0, -block.gravity), **values)
        self._simulation = wd.Simulation([body], obstacles=[wd.Obstacle("plane")], settings=settings)

    def advance_frame(self) -> None:
        self._simulation.advance_frame()

    def positions(self) -> Array:
        return self._simulation.bodies[0].positions()


class _MuJoCo(Session):
    """A three-dimensional flex under the `discrete` integrator, double precision, no damping."""

    def __init__(self, block: Block, values: dict[str, Any]) -> None:
        import mujoco

        self._shape, self._substeps, self._step = (block.nodes,) * 3 + (3,), values["substeps"], mujoco.mj_step
        self._model = mujoco.MjModel.from_xml_string(_xml(block, self._substeps, values["iterations"]))
        self._data: Any = mujoco.MjData(self._model)
        self._place = mujoco.mj_kinematics, mujoco.mj_flex

    def advance_frame(self) -> None:
        self._step(self._model, self._data, self._substeps)

    def positions(self) -> Array:
        for place in self._place:  # a step leaves the vertices where it began
            place(self._model, self._data)
        return np.array(self._data.flexvert_xpos).reshape(self._shape)


def _xml(block: Block, substeps: int, iterations: int) -> str:
    n, h = block.nodes, block.spacing
    return f"""<mujoco>
  <option timestep="{1.0 / (FPS * substeps)!r}" gravity="0 0 {-block.gravity}" integrator="discrete"
          solver="CG" tolerance="1e-6" iterations="{iterations}"/>
  <size memory="1G"/>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <flexcomp name="block" type="grid" dim="3" count="{n} {n} {n}" spacing="{h!r} {h!r} {h!r}"
              pos="0 0 {block.height + 0.5 * block.side!r}" mass="{block.mass!r}" radius="0.001">
      <edge equality="false"/>
      <elasticity young="{block.youngs_modulus!r}" poisson="{block.poisson_ratio!r}"/>
      <contact selfcollide="none"/>
    </flexcomp>
  </worldbody>
</mujoco>"""


class _NewtonVBD(Session):
    """Stable neo-Hookean tetrahedra, five in a cell, no damping; a frame is recorded as a graph.

    Contact is a penalty of 1e4 N/m for each node: softer, and the block sinks deeper.
    """

    def __init__(self, block: Block, values: dict[str, Any]) -> None:
        import newton
        import warp as wp

        n, h = block.nodes, block.spacing
        self._shape, self._launch = (n, n, n, 3), wp.capture_launch
        builder = newton.ModelBuilder(gravity=(0.0, 0.0, -block.gravity))
        builder.add_ground_plane()
        builder.add_soft_grid(
            pos=wp.vec3(0.0, 0.0, block.height),
            rot=wp.quat_identity(),
            vel=wp.vec3(0.0, 0.0, 0.0),
            dim_x=n - 1,
            dim_y=n - 1,
            dim_z=n - 1,
            cell_x=h,
            cell_y=h,
            cell_z=h,
            density=block.density,
            k_mu=block.shear_modulus,
            k_lambda=block.first_lame,
            k_damp=0.0,
            particle_radius=1e-3,
        )
        builder.color()
        model = builder.finalize(device="cpu")
        model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = 1e4, 0.0, 0.5
        self._solver = newton.solvers.SolverVBD(model=model, iterations=values["iterations"])
        self._states, self._control = [model.state(), model.state()], model.control()
        self._pipeline = newton.CollisionPipeline(model)
        self._contacts = self._pipeline.contacts()
        self._substeps: int = values["substeps"]
        start = [state.particle_q.numpy().copy() for state in self._states]
        self._simulate()  # loads the kernels, which a recording may not
        with wp.ScopedCapture(device="cpu") as capture:
            self._simulate()
        self._graph = capture.graph
        for state, positions in zip(self._states, start, strict=True):
            state.particle_q.assign(positions)
            state.particle_qd.zero_()

    def _simulate(self) -> None:
        for _ in range(self._substeps):
            before, after = self._states
            before.clear_forces()
            self._pipeline.collide(before, self._contacts)
            self._solver.step(before, after, self._control, self._contacts, 1.0 / (FPS * self._substeps))
            self._states.reverse()

    def advance_frame(self) -> None:
        self._launch(self._graph)

    def positions(self) -> Array:
        z_first: Array = self._states[0].particle_q.numpy().astype(np.float64).reshape(self._shape)
        return z_first.transpose(2, 1, 0, 3)  # its x runs fastest


BLOCK_ENGINES = {
    engine.name: engine
    for engine in (
        BlockEngine(
            "ours",
            "warpdeform",
            (
                Setting("dt 1/60, 1 Newton", {}, example=True),
                Setting("dt 1/60, 2 Newton", {"newton_iterations": 2}),
                Setting("dt 1/240, 2 Newton", {"substeps": 4, "newton_iterations": 2}),
            ),
            _Ours,
        ),
        BlockEngine(
            "mujoco",
            "mujoco",
            tuple(
                Setting(f"dt 1/{FPS * s}, {k} iterations", {"substeps": s, "iterations": k}, example=s == 8)
                for s, k in ((4, 50), (8, 50), (16, 100))
            ),
            _MuJoCo,
        ),
        BlockEngine(
            "newton-vbd",
            "newton",
            tuple(
                Setting(f"{s} substeps, {k} iterations", {"substeps": s, "iterations": k}, example=(s, k) == (10, 10))
                for s, k in ((10, 10), (20, 5))
            ),
            _NewtonVBD,
        ),
    )
}
"""All of them by name, this engine first."""
