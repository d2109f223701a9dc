"""Small vibrations: prestretched strings and drums exact on the grid, beams and plates against theory (design 1.6).

Frequencies follow from K u = omega^2 M u, with the products K u that conjugate gradient is given: at rest and in
uniform tension the projected Hessian is the exact one. One string is also plucked and stepped, against what each method
makes of an oscillator.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from physics.statics import Array, listed, orders, percent, skewed_square
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import eigsh

from warpdeform.body import Body, Pin
from warpdeform.handle import BodyHandle
from warpdeform.material import Material
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, sheet
from warpdeform.simulation import Simulation

DENSITY, STIFFNESS = 0.3, 40.0
"""Mass per area [kg/m2] and E h [N/m] of strings and drums."""
STRETCH = 1.2
FREE_SQUARE = (13.468, 19.596, 24.270, 34.80)
"""omega sqrt(rho h a^4 / D) of the free square plate with nu = 0.3; the last one is double."""
CLAMPED_FREE = (1.87510, 4.69409)
"""beta L of a clamped beam."""


def build(body: Body, **settings: object) -> Simulation:
    words = {"precision": "float64", "device": "cpu", "gravity": (0.0, 0.0, 0.0), **settings}
    return Simulation([body], settings=Settings(**words))  # type: ignore[arg-type]


def stiffness_product(handle: BodyHandle) -> Callable[[Array], Array]:
    """u -> K u of the elastic energy at the body's present positions, shapes (nu, nv, 3)."""
    state, layout = handle.state, handle.model.layout
    handle.elasticity.linearise(state, state.x)

    def product(u: Array) -> Array:
        state.search.assign(layout.pack(u))
        state.product.zero_()
        handle.elasticity.add_hessian_product(state, state.search, state.product)
        return handle.model.download(state.product)

    return product


def normal_frequencies(handle: BodyHandle, free: Array, count: int) -> Array:
    """The lowest frequencies [1/s] of motions along z of the nodes where `free` is true.

    A row of K reaches two nodes far, so that 25 products with every fifth node lifted along both axes give all of them.
    """
    product = stiffness_product(handle)
    i, j = (index.ravel() for index in np.indices(handle.nodes))
    K = np.zeros((i.size, i.size))
    for first in range(5):
        for second in range(5):
            lifted = (i % 5 == first) & (j % 5 == second)
            u = np.zeros((*handle.nodes, 3))
            u[i[lifted], j[lifted], 2] = 1.0
            force = product(u)[..., 2].ravel()
            for node in np.flatnonzero(lifted):
                near = (np.abs(i - i[node]) <= 2) & (np.abs(j - j[node]) <= 2)
                K[near, node] = force[near]
    K = K[np.ix_(free.ravel(), free.ravel())]
    np.testing.assert_allclose(K, K.T, atol=1e-10 * np.abs(K).max())
    mass = diags_array(handle.model.node_mass[free])
    squares = eigsh(csc_array(K), count, mass.tocsc(), sigma=-1.0, return_eigenvectors=False)
    return np.sqrt(np.maximum(np.sort(squares), 0.0))


def string(nodes: int = 13, *, amplitude: float = 0.0, mode: int = 1, **settings: object) -> Simulation:
    """A strip of unit rest length between pins, stretched by `STRETCH`, plucked in one mode along z."""
    shape = sheet((nodes, 2), (1.0, 0.2))
    start = shape.positions * [STRETCH, 1.0, 1.0]
    start[..., 2] = amplitude * np.sin(mode * np.pi * shape.positions[..., 0])
    material = Material(areal_density=DENSITY, membrane_stiffness=STIFFNESS, poisson_ratio=0.0)
    pins = (Pin("edge:u,0"), Pin("edge:u,1"))
    return build(Body("string", shape, material, initial_positions=start, pins=pins), **settings)


def string_frequency(mode: int, spacing: float, factor: float) -> float:
    """Exact on the grid: (2/h) sin(n pi h / 2 L) sqrt(E h factor / (2 mu))."""
    return 2.0 / spacing * np.sin(0.5 * mode * np.pi * spacing) * np.sqrt(STIFFNESS * factor / (2.0 * DENSITY))


@pytest.mark.parametrize(("axis", "factor"), [(2, STRETCH**2 - 1), (0, 3 * STRETCH**2 - 1)], ids=["across", "along"])
def test_prestretched_string_is_exact_on_the_grid(axis: int, factor: float) -> None:
    nodes = 13
    handle = string(nodes)["string"]
    product = stiffness_product(handle)
    x = np.linspace(0.0, 1.0, nodes)
    worst = 0.0
    for mode in range(1, nodes - 1):
        u = np.zeros((nodes, 2, 3))
        u[..., axis] = np.sin(mode * np.pi * x)[:, None]
        square = string_frequency(mode, 1.0 / (nodes - 1), factor) ** 2
        force = product(u)[1:-1] / handle.model.node_mass[1:-1, :, None]
        worst = max(worst, float(np.abs(force - square * u[1:-1]).max()) / square)
    print(f"\nstring {'along' if axis == 0 else 'across'}, all {nodes - 2} modes: error of omega^2 {worst:.1e}", end="")
    assert worst < 1e-12


def test_prestretched_square_drum_is_exact_on_the_grid() -> None:
    nodes, nu = 9, 0.3
    shape = sheet((nodes, nodes))
    material = Material(areal_density=DENSITY, membrane_stiffness=STIFFNESS, poisson_ratio=nu)
    pins = tuple(Pin(f"edge:{axis},{end}") for axis in "uv" for end in (0, 1))
    start = shape.positions * [STRETCH, STRETCH, 1.0]
    handle = build(Body("drum", shape, material, initial_positions=start, pins=pins))["drum"]
    inside = np.zeros((nodes, nodes), dtype=bool)
    inside[1:-1, 1:-1] = True
    count = 20
    found = normal_frequencies(handle, inside, count)
    waves = (2.0 * (nodes - 1) * np.sin(0.5 * np.pi * np.arange(1, nodes - 1) / (nodes - 1))) ** 2
    speed_squared = STIFFNESS * (STRETCH**2 - 1) / (2.0 * (1.0 - nu) * DENSITY)
    exact = np.sort(np.sqrt(speed_squared * np.add.outer(waves, waves)), axis=None)[:count]
    error = float(np.abs(found / exact - 1).max())
    print(f"\nsquare drum, lowest {count} modes: error of omega {error:.1e}", end="")
    assert error < 1e-12


@pytest.mark.parametrize("integrator", ["implicit-euler", "bdf2"])
def test_plucked_string_follows_the_integrator_exactly(integrator: str) -> None:
    """A mode in complex form u = x + i v/omega obeys u' = -i omega u; each method turns that into a recurrence.

    Backward Euler: amplitude (1 + omega^2 dt^2)^(-1/2) a step, frequency atan(omega dt)/dt (design 1.6).
    """
    amplitude, nodes, fps = 1e-6, 13, 60.0
    precise: dict[str, Any] = {"fps": fps, "newton_iterations": 0, "newton_tolerance": 1e-12, "cg_tolerance": 1e-8}
    simulation = string(nodes, amplitude=amplitude, integrator=integrator, **precise)
    turn = 1j * string_frequency(1, 1.0 / (nodes - 1), STRETCH**2 - 1) / fps
    u = [1.0 + 0.0j]
    worst = 0.0
    for step in range(40):
        simulation.step()
        first = integrator == "implicit-euler" or step == 0
        u.append(u[-1] / (1.0 + turn) if first else (4.0 * u[-1] - u[-2]) / 3.0 / (1.0 + 2.0 * turn / 3.0))
        found = simulation["string"].positions()[nodes // 2, :, 2] / amplitude
        worst = max(worst, float(np.abs(found - u[-1].real).max()))
    print(f"\nplucked string, {integrator}, 40 steps: error over amplitude {worst:.1e}", end="")
    assert worst < 1e-9


def strip_frequencies(cells: int, length: float, clamped_rows: int) -> Array:
    """Lowest bending frequencies of a strip of unit D and mass per area, its first rows pinned, uniform across."""
    material = Material(areal_density=1.0, membrane_stiffness=1e4, poisson_ratio=0.0, bending_stiffness=1.0)
    handle = build(Body("strip", sheet((cells + 1, 3), (length, 0.1)), material))["strip"]
    product = stiffness_product(handle)
    K = np.empty((cells + 1, cells + 1))
    for i in range(cells + 1):
        unit = np.zeros((cells + 1, 3, 3))
        unit[i, :, 2] = 1.0
        row = product(unit)[..., 2]
        np.testing.assert_allclose(row / handle.model.node_mass, (row / handle.model.node_mass)[:, :1] * [[1, 1, 1]])
        K[i] = row.sum(axis=1)
    free = slice(clamped_rows, None)
    mass = np.diag(handle.model.node_mass.sum(axis=1)[free])
    return np.sqrt(np.maximum(scipy.linalg.eigh(K[free, free], mass, eigvals_only=True), 0.0))


def test_clamped_beam_vibrates_as_euler_and_bernoulli_say() -> None:
    cells = (10, 20, 40)
    exact = np.array(CLAMPED_FREE) ** 2
    errors = np.array([strip_frequencies(n, n / (n - 0.5), 2)[:2] / exact - 1 for n in cells])
    for name, column in zip(("first", "second"), errors.T, strict=True):
        print(f"\nclamped beam, {name} mode, cells {cells}: errors", end=" ")
        print(f"{percent(column)}; orders {listed(orders(column))}", end="")
    assert orders(errors).min() > 1.9
    assert np.abs(errors[-1]).max() < 5e-3


def plate(cells: int, shape: RestShape | None = None) -> BodyHandle:
    """A free square plate, nu = 0.3, of unit side, D and mass per area."""
    material = Material(areal_density=1.0, membrane_stiffness=1e4, poisson_ratio=0.3, bending_stiffness=1.0)
    return build(Body("plate", shape or sheet((cells + 1, cells + 1)), material))["plate"]


def test_free_plate_vibrates_as_kirchhoff_says() -> None:
    cells = (8, 16, 32)
    found = [normal_frequencies(plate(n), np.ones((n + 1, n + 1), dtype=bool), 8) for n in cells]
    errors = np.array([frequencies[3:7] / FREE_SQUARE - 1 for frequencies in found])
    print(f"\nfree plate, modes 1-4, {cells[-1]} cells: errors {percent(errors[-1])}", end="")
    print(f"; orders from {cells[-2]} cells {listed(orders(errors)[-1])}", end="")
    for frequencies in found:
        assert np.all(frequencies[:3] < 1e-3)  # three rigid motions
        assert abs(frequencies[6] / frequencies[7] - 1) < 1e-9  # the double one
    assert orders(errors).min() > 1.8
    assert np.abs(errors[-1]).max() < 5e-3


def test_free_plate_on_a_skewed_chart_vibrates_as_kirchhoff_says() -> None:
    cells = 32
    everywhere = np.ones((cells + 1, cells + 1), dtype=bool)
    found = normal_frequencies(plate(cells, skewed_square(cells)), everywhere, 7)
    errors = found[3:] / FREE_SQUARE - 1
    print(f"\nfree plate on a skewed chart, modes 1-4, {cells} cells: errors {percent(errors)}", end="")
    assert np.all(found[:3] < 1e-3)  # three rigid motions
    assert np.abs(errors).max() < 5e-3


def test_supported_plate_vibrates_as_navier_says() -> None:
    cells = (8, 16)
    exact = np.pi**2 * np.array([2.0, 5.0, 5.0, 8.0])
    errors = []
    for count in cells:
        inside = np.zeros((count + 1, count + 1), dtype=bool)
        inside[1:-1, 1:-1] = True
        errors.append(normal_frequencies(plate(count), inside, 4) / exact - 1)
    print(f"\nsupported plate, modes 1-4, {cells[-1]} cells: errors {percent(errors[-1])}", end="")
    print(f"; orders from {cells[0]} cells {listed(orders(errors))}", end="")
    assert orders(errors).min() > 1.9
    assert np.abs(errors[-1]).max() < 0.015
