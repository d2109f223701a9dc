"""Static answers: backward Euler to tolerance with very large steps (design 4.1), and what is read off them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.body import Body
from warpdeform.handle import BodyHandle
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, from_map
from warpdeform.simulation import Simulation

Array = NDArray[np.float64]

GRAVITY = 9.81
AT_REST = 1e-4
"""Largest unbalanced force over node weight that counts as rest."""


def equilibrium(body: Body, *, dt: float = 100.0, gravity: Sequence[float] = (0.0, 0.0, -GRAVITY)) -> Simulation:
    """The simulation of one body, stepped until it stands still.

    Steps of `dt` [s] end when no node moves by more than 1e-7 of the body's length from one to the next. Small steps
    find the way from a start without stiffness, such as a slack chain; large ones need few.
    """
    settings = Settings(
        integrator="implicit-euler",
        fps=1.0 / dt,
        newton_iterations=0,
        newton_tolerance=1e-8,
        cg_tolerance=1e-4,
        cg_iterations=50000,
        precision="float64",
        device="cpu",
        gravity=(gravity[0], gravity[1], gravity[2]),
    )
    simulation = Simulation([body], settings=settings)
    handle = simulation.bodies[0]
    last = handle.positions()
    still = 1e-7 * float(np.ptp(handle.rest_positions, axis=(0, 1)).max())
    for _ in range(100):
        report = simulation.step()
        now = handle.positions()
        moved, last = float(np.abs(now - last).max()), now
        if moved < still:
            assert report.residual < AT_REST * GRAVITY, f"stands still out of balance: {report}"
            return simulation
    raise AssertionError(f"still moving by {moved:g} m a step: {report}")


def skewed_square(cells: int) -> RestShape:
    """The unit square with straight edges and axes that meet at 53 to 127 degrees, some of them at the border."""
    wave = 2 * np.pi

    def leaning(u: Array, v: Array) -> Array:
        return np.stack([u + 0.12 * np.sin(wave * u) * np.sin(wave * v), v, 0 * u], axis=-1)

    return from_map(leaning, (cells + 1, cells + 1), ((0, 1), (0, 1)))


def elastic_forces(handle: BodyHandle) -> Array:
    """Elastic force on each node [N], shape (nu, nv, 3); at rest a pin carries it together with the node's weight."""
    state, gradient = handle.state, handle.model.zeros(3)
    handle.elasticity.linearise(state, state.x)
    handle.elasticity.add_gradient(state, state.x, gradient)
    return -handle.model.download(gradient)


def orders(errors: ArrayLike) -> Array:
    """Orders of convergence of errors at resolutions that double along the first axis."""
    sizes = np.abs(np.asarray(errors, dtype=np.float64))
    return np.asarray(np.log2(sizes[:-1] / sizes[1:]))


def percent(errors: ArrayLike, digits: int = 3) -> str:
    """Relative errors as people read them."""
    return ", ".join(f"{error:+.{digits}%}" for error in np.ravel(errors))


def listed(numbers: ArrayLike) -> str:
    """Numbers with two decimals."""
    return ", ".join(f"{number:.2f}" for number in np.ravel(numbers))
