"""Small vibrations of solids: bars exact on the grid, beams against theory, free blocks and their six motions."""

import numpy as np
import pytest
from physics.statics import Array, listed, orders, percent
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import eigsh
from solids import Block, Nodes, Term, bent, box, stiffness_matrix

from warpdeform.material import Material

E, DENSITY = 1e6, 1000.0


def frequencies(rest: Block, nu: float, free: Array, count: int) -> Array:
    """The lowest frequencies [1/s] of a block whose coordinates are free where `free` is true."""
    solid = Term(rest, Material(density=DENSITY, youngs_modulus=E, poisson_ratio=nu))
    solid.linearise(rest.positions)
    inside = np.flatnonzero(free)
    K = csc_array(stiffness_matrix(solid)[inside][:, inside])
    mass = DENSITY * np.repeat(solid.stiffness.node_volume.ravel(), 3)[inside]
    squares = eigsh(K, count, diags_array(mass).tocsc(), sigma=-1.0, return_eigenvectors=False)
    return np.asarray(np.sqrt(np.maximum(np.sort(squares), 0.0)))


def clamped(nodes: Nodes) -> Array:
    free = np.ones((*nodes, 3), dtype=bool)
    free[0] = False
    return free


def test_bar_swings_at_its_exact_frequencies() -> None:
    """omega = (2/h) sqrt(E/rho) sin((2 n - 1) pi h/4 L) of a bar of nu = 0, fixed at one end."""
    cells, length = 8, 2.0
    rest = box((cells + 1, 3, 2), (length, 0.3, 0.2))
    free = clamped(rest.nodes)
    free[..., 1:] = False
    solid = Term(rest, Material(density=DENSITY, youngs_modulus=E, poisson_ratio=0.0))
    solid.linearise(rest.positions)
    mass = DENSITY * solid.stiffness.node_volume[..., None]
    for mode in range(1, cells + 1):
        phase = (2 * mode - 1) * np.pi / (2 * length)
        u = np.zeros_like(rest.positions)
        u[..., 0] = np.sin(phase * rest.positions[..., 0])
        square = (2 * cells / length * np.sin(phase * length / cells / 2)) ** 2 * E / DENSITY
        error = (solid.product(u) - square * mass * u)[1:]
        assert np.abs(error).max() < 1e-11 * np.abs(square * mass * u).max()


@pytest.mark.parametrize(
    ("end", "nu", "beta"),
    [("clamped", 0.0, 1.87510), ("free", 0.0, 4.73004), ("free", 0.3, 4.73004), ("free", 0.49, 4.73004)],
)
def test_block_vibrates_as_euler_and_bernoulli_say(end: str, nu: float, beta: float) -> None:
    """beta L of a slender beam, free at one end and this at the other (design 1.6), two by two cells thick."""
    thickness, cells = 0.02, (8, 16, 32)
    exact = beta**2 * thickness * np.sqrt(E / DENSITY / 12)
    errors = []
    for n in cells:
        rest = box((n + 1, 3, 3), (1.0, thickness, thickness))
        free = clamped(rest.nodes) if end == "clamped" else np.ones((*rest.nodes, 3), dtype=bool)
        found = frequencies(rest, nu, free, 2 if end == "clamped" else 8)[-2:]
        assert found[0] == pytest.approx(found[1], rel=1e-6)
        errors.append(found[0] / exact - 1)
    print(f"\nblock, {end} end, nu {nu:g}, cells {cells}: errors {percent(errors, 2)}", end="")
    print(f"; orders {listed(orders(errors))}", end="")
    assert orders(errors)[0] > 1.6
    assert abs(errors[-1]) < 0.005


@pytest.mark.parametrize("make", [box, bent])
def test_free_block_has_six_motions_without_frequency(make: object) -> None:
    rest = make((4, 5, 4))  # type: ignore[operator]
    found = frequencies(rest, 0.3, np.ones((*rest.nodes, 3), dtype=bool), 8)
    assert found[5] < 1e-3 * found[6]
    assert found[6] > 1.0
