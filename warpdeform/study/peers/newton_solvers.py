"""The cloth solvers of Newton: VBD, XPBD and Style3D."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from warpdeform.study.peers import laws
from warpdeform.study.peers.engine import Engine, Session, Setting
from warpdeform.study.peers.sheet import FPS, Array, Sheet


class _NewtonEngine(Engine):
    """What the three share: masses, pins, and a limit that is computed from the law."""

    package: ClassVar[str] = "newton"
    example: ClassVar[tuple[int, int]]
    """Substeps per frame and iterations of the engine's own hanging cloth."""

    @abstractmethod
    def best(self, nodes: int) -> tuple[tuple[int, int], ...]:
        """Further substeps per frame and iterations, from the front of time against error."""

    @abstractmethod
    def terms(self, sheet: Sheet) -> Sequence[laws.Forces]:
        """The forces of the law in double precision."""

    @abstractmethod
    def build(self, newton: Any, sheet: Sheet) -> Any:
        """The model builder with the sheet in it, masses and pins aside."""

    @abstractmethod
    def solver(self, newton: Any, model: Any, iterations: int) -> Any:
        """The solver."""

    records: ClassVar[bool] = True
    """Whether a step can be recorded as a graph on the CPU."""

    def settings(self, nodes: int) -> tuple[Setting, ...]:
        """The example's substeps and iterations, and others."""
        return tuple(
            Setting(f"{s} substeps, {k} iterations", {"substeps": s, "iterations": k}, example=(s, k) == self.example)
            for s, k in (self.example, *self.best(nodes))
        )

    def references(self, nodes: int) -> tuple[Setting, Setting]:
        """The law in double precision with a third of the longest stable step, and two thirds."""
        substeps = Sheet(nodes).explicit_substeps(2 / 3)
        fine, coarse = ({"verlet_substeps": k * substeps} for k in (2, 1))
        return Setting("law in double precision", fine), Setting("law in double precision, twice the step", coarse)

    def prepare(self, sheet: Sheet, setting: Setting) -> Session:
        """Build the model and record a frame; the law alone if the setting is a reference."""
        if "verlet_substeps" in setting.values:
            return laws.Verlet(sheet, self.terms(sheet), setting.values["verlet_substeps"])
        return _NewtonSession(self, sheet, setting)

    def sources(self) -> tuple[Path, ...]:
        """The law in double precision, too."""
        return *super().sources(), Path(laws.__file__)


class _NewtonSession(Session):
    def __init__(self, engine: _NewtonEngine, sheet: Sheet, setting: Setting) -> None:
        import newton
        import warp as wp

        self._launch, self._shape = wp.capture_launch, (sheet.nodes, sheet.nodes, 3)
        builder = engine.build(newton, sheet)
        for k, mass in enumerate(sheet.masses().ravel()):
            builder.particle_mass[k] = float(mass)
        for k in sheet.pinned():
            builder.particle_mass[k] = 0.0
            builder.particle_flags[k] &= ~int(newton.ParticleFlags.ACTIVE)
        builder.color(include_bending=True)
        model = builder.finalize(device="cpu")
        self._solver = engine.solver(newton, model, setting.values["iterations"])
        self._states, self._control = [model.state(), model.state()], model.control()
        self._start: Array = model.particle_q.numpy().copy()
        self._substeps: int = setting.values["substeps"]
        self._dt = 1.0 / (FPS * self._substeps)
        self._graph: Any = None
        self._simulate(wp.copy)  # loads the kernels, which a recording may not
        self._rewind()
        if engine.records:
            with wp.ScopedCapture(device="cpu") as capture:
                self._simulate(wp.copy)
            self._graph = capture.graph
            self._rewind()
        self._copy: Callable[..., None] = wp.copy

    def advance_frame(self) -> None:
        if self._graph is not None:
            self._launch(self._graph)
        else:
            self._simulate(self._copy)

    def positions(self) -> Array:
        return self._states[0].particle_q.numpy().astype(np.float64).reshape(self._shape)

    def _simulate(self, copy: Callable[..., None]) -> None:
        before, after = self._states
        for _ in range(self._substeps):
            before.clear_forces()
            self._solver.step(before, after, self._control, None, self._dt)
            before, after = after, before
        if before is not self._states[0]:  # an odd number of steps ends in the other state
            copy(self._states[0].particle_q, before.particle_q)
            copy(self._states[0].particle_qd, before.particle_qd)

    def _rewind(self) -> None:
        for state in self._states:
            state.particle_q.assign(self._start)
            state.particle_qd.zero_()


class NewtonVBD(_NewtonEngine):
    """Newton's vertex block descent.

    Membrane: its `tri_ke` and `tri_ka` are the Lame parameters of a stable neo-Hookean membrane, here Eh / (2 (1 + nu))
    and Eh nu / (1 - nu^2). Bending: hinges store edge_ke times length times angle^2 / 2, so D / h stores D / 2 per area
    and squared curvature when a sheet rolls along its grid. No damping, as in the scene.
    """

    name: ClassVar[str] = "newton-vbd"
    law: ClassVar[str] = "stable neo-Hookean triangles, dihedral angles"
    example: ClassVar[tuple[int, int]] = (10, 10)

    def best(self, nodes: int) -> tuple[tuple[int, int], ...]:
        """Few iterations, many substeps."""
        return (5, 10), (20, 5), (40, 2), (40, 5)

    def terms(self, sheet: Sheet) -> Sequence[laws.Forces]:
        """Triangles and hinges."""
        stress, D = laws.neo_hookean(sheet.first_lame, sheet.shear_modulus), sheet.bending_stiffness
        return laws.membrane(stress, sheet.spacing), laws.hinges(D, D * np.sqrt(2.0))

    def build(self, newton: Any, sheet: Sheet) -> Any:
        """A cloth mesh with triangles and hinges."""
        builder = newton.ModelBuilder()
        builder.add_cloth_mesh(
            **_mesh(sheet),
            tri_ke=sheet.shear_modulus,
            tri_ka=sheet.first_lame,
            tri_kd=0.0,
            edge_ke=sheet.bending_stiffness / sheet.spacing,
            edge_kd=0.0,
        )
        return builder

    def solver(self, newton: Any, model: Any, iterations: int) -> Any:
        """Without self-contact, of which the scene has none."""
        return newton.solvers.SolverVBD(model, iterations=iterations)


class NewtonXPBD(_NewtonEngine):
    """Newton's extended position-based dynamics.

    Membrane: springs along the grid (3/4 Eh, half on the rim) and both diagonals (3/8 Eh), the isotropic spring lattice
    of Young's modulus Eh, whose Poisson ratio is 1/3. Bending: its constraint on the dihedral angle follows the angle's
    gradient times twice the triangles' area h^2, so edge_ke is D / h^2. No damping.
    """

    name: ClassVar[str] = "newton-xpbd"
    law: ClassVar[str] = "springs along the grid and its diagonals, dihedral angles"
    example: ClassVar[tuple[int, int]] = (10, 10)

    def best(self, nodes: int) -> tuple[tuple[int, int], ...]:
        """One iteration and substeps in proportion to the nodes along a side: fewer, and the corrections add up."""
        return tuple((-(-share * nodes // 16), 1) for share in (30, 40, 60))

    def terms(self, sheet: Sheet) -> Sequence[laws.Forces]:
        """Springs and hinges."""
        bending = sheet.bending_stiffness / sheet.spacing**2
        return (
            laws.springs(sheet.axis_spring, sheet.diagonal_spring, sheet.spacing),
            laws.hinges(bending, bending, true_gradient=False),
        )

    def build(self, newton: Any, sheet: Sheet) -> Any:
        """A cloth mesh for the hinges, and springs of their own stiffness each."""
        builder = newton.ModelBuilder()
        builder.add_cloth_mesh(**_mesh(sheet), edge_ke=sheet.bending_stiffness / sheet.spacing**2, edge_kd=0.0)
        for i, j, stiffness in sheet.springs():
            builder.add_spring(i, j, stiffness, 0.0, control=0.0)
        return builder

    def solver(self, newton: Any, model: Any, iterations: int) -> Any:
        """Without contact between particles, of which the scene has none."""
        model.particle_grid = None
        return newton.solvers.SolverXPBD(model, iterations=iterations)


class NewtonStyle3D(_NewtonEngine):
    """Newton's projective dynamics for garments.

    Membrane: stiffness along both threads Eh (it has no lateral effect), shear Eh / (2 (1 + nu)). Bending: k / 2 times
    3 / A |sum of cotangent weights times positions|^2 at each edge, so k = D / 3 stores D / 2 per area and squared
    curvature when a sheet rolls along its grid; the solver takes 33/32 of k on diagonals. Every step multiplies
    velocities by 0.998, whatever its length, so shorter steps lose more: the law has no such drag, the scene neither.
    """

    name: ClassVar[str] = "newton-style3d"
    law: ClassVar[str] = "stretch of threads, shear angle, quadratic bending"
    records: ClassVar[bool] = False
    example: ClassVar[tuple[int, int]] = (2, 10)

    def best(self, nodes: int) -> tuple[tuple[int, int], ...]:
        """The substeps and iterations of its other example, and more iterations: a step loses 0.2 % of the speed."""
        return (10, 4), (2, 40), (4, 40)

    def terms(self, sheet: Sheet) -> Sequence[laws.Forces]:
        """Triangles and quadratic bending."""
        bending = sheet.bending_stiffness / 3
        stress = laws.stretch_and_shear(sheet.membrane_stiffness, sheet.shear_modulus)
        return (
            laws.membrane(stress, sheet.spacing),
            laws.quadratic_bending(bending, bending * 33 / 32, sheet.spacing),
        )

    def build(self, newton: Any, sheet: Sheet) -> Any:
        """A garment panel."""
        import warp as wp
        from newton.solvers import style3d

        builder, bending = newton.ModelBuilder(), sheet.bending_stiffness / 3
        newton.solvers.SolverStyle3D.register_custom_attributes(builder)
        style3d.add_cloth_mesh(
            builder,
            **_mesh(sheet),
            tri_aniso_ke=wp.vec3(sheet.membrane_stiffness, sheet.membrane_stiffness, sheet.shear_modulus),
            edge_aniso_ke=wp.vec3(bending, bending, bending),
        )
        return builder

    def solver(self, newton: Any, model: Any, iterations: int) -> Any:
        """Without collisions, of which the scene has none."""
        config = newton.solvers.SolverStyle3D.Config(iterations=iterations)
        solver = newton.solvers.SolverStyle3D(model, config=config)
        solver.collision = None
        return solver


def _mesh(sheet: Sheet) -> dict[str, Any]:
    """The arguments that every cloth mesh takes."""
    import warp as wp

    return {
        "pos": wp.vec3(0.0, 0.0, 0.0),
        "rot": wp.quat_identity(),
        "scale": 1.0,
        "vel": wp.vec3(0.0, 0.0, 0.0),
        "vertices": [wp.vec3(*point) for point in sheet.positions().reshape(-1, 3)],
        "indices": sheet.triangles().ravel().tolist(),
        "density": sheet.areal_density,
        "particle_radius": 0.0,
    }
