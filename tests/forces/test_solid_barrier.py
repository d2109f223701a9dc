"""The barrier against inversion: its formula in NumPy, finite differences, invariants, and what it is there for."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from solids import AXES, MATERIALS, SHAPES, BarrierEnergy, Term, bent, box, crumpled, squashed, stretched, volume_ratio
from surfaces import REALS, WIDTHS, noise, turned

from warpdeform.errors import InputError
from warpdeform.forces.solid_barrier import InversionBarrier, refuse_inverted
from warpdeform.kernels.solid_barrier import LEAST
from warpdeform.material import Material

Array = np.ndarray[Any, Any]

SMALL = (3, 2, 4)
STRENGTH = 2e4


def barrier(shape: str, nodes: tuple[int, int, int] = SMALL, real: Any = wp.float64, width: int = 1) -> Term:
    return Term(SHAPES[shape](nodes), MATERIALS["barrier"], real, width, InversionBarrier)


def largest(a: Array) -> float:
    return float(np.abs(a).max())


@pytest.mark.parametrize("shape", ["box", "bent"])
@pytest.mark.parametrize("state", [crumpled, squashed])
def test_energy_gradient_hessian_and_blocks_are_those_of_the_formula(shape: str, state: Any) -> None:
    term, formula = barrier(shape), BarrierEnergy(SHAPES[shape](SMALL).positions, STRENGTH)
    z = state(term.rest)
    assert volume_ratio(z, term.rest).min() < 0.9
    assert term.energy(z) == pytest.approx(formula.energy(z).real, rel=1e-13)
    gradient, hessian = formula.gradient(z), formula.projected_hessian(z)
    assert largest(term.gradient(z) - gradient) < 1e-13 * largest(gradient)
    H = term.dense()
    assert largest(H - hessian) < 1e-13 * largest(hessian)
    assert largest(H - H.T) < 1e-13 * largest(H)
    diagonal = np.einsum("ikil->ikl", H.reshape(24, 3, 24, 3)).reshape(*SMALL, 3, 3)
    assert largest(term.blocks() - diagonal) < 1e-13 * largest(diagonal)
    assert np.linalg.eigvalsh(H).min() > -1e-13 * largest(H)


@pytest.mark.parametrize("nodes", [(2, 2, 2), (3, 4, 17)], ids=str)
def test_gradient_is_the_difference_of_the_energy(nodes: tuple[int, int, int]) -> None:
    term = barrier("bent", nodes)
    z, step = squashed(term.rest), 1e-6
    gradient = term.gradient(z)
    for seed in range(3):
        p = noise(term.rest, 1.0, seed)
        slope = (term.energy(z + step * p) - term.energy(z - step * p)) / (2 * step)
        assert abs(np.sum(gradient * p) - slope) < 1e-6 * np.linalg.norm(gradient) * np.linalg.norm(p)


def test_nothing_is_felt_at_rest_nor_in_tension() -> None:
    term = barrier("bent")
    for z in (term.rest, turned(term.rest, (1, 2, 3), 0.7) + 0.3, stretched(term.rest)):
        assert volume_ratio(z, term.rest).min() > 1 - 1e-12
        assert term.energy(z) < 1e-25
        assert largest(term.gradient(z)) < 1e-20
        assert largest(term.product(noise(term.rest, 1.0))) < 1e-7


@pytest.mark.parametrize("real", REALS)
def test_no_net_force_and_torque(real: Any) -> None:
    term = barrier("bent", (4, 3, 5), real)
    z = squashed(term.rest)
    force = term.gradient(z).astype(np.float64)
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    assert largest(force.sum(AXES)) < 4 * epsilon * np.abs(force).sum()
    torque = np.cross(z, force)
    assert largest(torque.sum(AXES)) < 8 * epsilon * np.abs(force).sum() * np.linalg.norm(np.ptp(z, axis=AXES))


def test_lane_widths_agree_to_the_bit_and_precisions_to_round_off() -> None:
    z, p = squashed(bent((3, 4, 18)).positions), noise(bent((3, 4, 18)).positions, 1.0, 4)
    exact = None
    for real in REALS:
        narrow, wide = (barrier("bent", (3, 4, 18), real, width) for width in WIDTHS[real])
        for found in ("gradient", "product", "blocks"):
            values = [
                getattr(term, found)(*{"gradient": [z], "product": [p], "blocks": []}[found]) for term in (narrow, wide)
            ]
            np.testing.assert_array_equal(values[0], values[1], err_msg=found)
        assert narrow.energy(z) == pytest.approx(wide.energy(z), rel=1e-13)
        results = narrow.energy(z), narrow.gradient(z), narrow.product(p)
        exact = exact or results
    for values, expected in zip(results, exact, strict=True):
        np.testing.assert_allclose(values, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("real", REALS)
def test_flat_and_inverted_cells_cost_infinitely_much_and_stay_finite_otherwise(real: Any) -> None:
    term = barrier("box", (3, 3, 3), real)
    flat, inverted, pushed = term.rest * [1, 1, 0.5 * LEAST], term.rest * [1, 1, -1], term.rest.copy()
    pushed[1, 1, 1] += 0.9
    for z in (flat, inverted, pushed, 0 * term.rest):
        assert volume_ratio(z, term.rest).min() <= LEAST
        assert term.energy(z) == np.inf
        assert np.isfinite(term.gradient(z)).all()
        assert np.isfinite(term.product(noise(term.rest, 1.0))).all()
        assert np.isfinite(term.blocks()).all()
    assert np.isfinite(term.energy(term.rest * [1, 1, 2 * LEAST]))


def test_rows_between_the_planes_and_lanes_behind_them_cost_nothing() -> None:
    term = barrier("box", (3, 3, 5), wp.float32, 16)
    partials = wp.zeros((term.layout.rows, term.layout.columns), dtype=wp.float64, device="cpu")
    term.force.add_energy(None, term.upload(term.rest + 5.0), partials)
    assert np.isfinite(partials.numpy()).all()


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_stress_of_a_pressed_bar_rises_all_the_way(nu: float) -> None:
    """Without the barrier it falls again from a stretch of 1/sqrt 3 on, at -0.192 E (design 1.3)."""
    material = Material(density=1000.0, youngs_modulus=1.0, poisson_ratio=nu, inversion_barrier=0.05)
    rest = box((2, 2, 2), (1.0, 1.0, 1.0))
    terms = [Term(rest, material), Term(rest, material, kind=InversionBarrier)]

    def energy(stretch: float, lateral: float, terms: list[Term]) -> float:
        return sum(term.energy(rest.positions * [stretch, lateral, lateral]) for term in terms)

    def relaxed(stretch: float, terms: list[Term]) -> float:
        lateral, step = np.sqrt(1 + nu * (1 - stretch**2)), 1e-4
        for _ in range(50):
            low, mid, high = (energy(stretch, lateral + d, terms) for d in (-step, 0.0, step))
            change = -0.5 * step * (high - low) / (high - 2 * mid + low)
            lateral += float(np.clip(change, -0.05, 0.05))
            if abs(change) < 1e-10:
                break
        return energy(stretch, lateral, terms)

    stretches = np.linspace(0.2, 0.95, 16)
    stress = [np.gradient([relaxed(s, use) for s in stretches], stretches) for use in (terms[:1], terms)]
    assert stress[0].min() == pytest.approx(-0.192, abs=0.004)
    assert stress[0][0] > -0.15
    assert np.diff(stress[1]).min() > 0


def test_start_that_is_inverted_is_refused_with_its_cell() -> None:
    rest = box((4, 3, 5))
    refuse_inverted(rest.grid, rest.positions, squashed(rest.positions))
    pushed = rest.positions.copy()
    pushed[2, 1, 3] += [0.0, 0.0, 1.2]
    with pytest.raises(
        InputError, match=r"initial_positions = \[\d, \d, 3\]: has a cell that is flat or turned inside"
    ):
        refuse_inverted(rest.grid, rest.positions, pushed)


def test_barrier_is_a_module_of_its_own_and_names_its_kernels() -> None:
    term = barrier("box")
    assert {name.split(".")[0] for name in term.force.kernels} == {"solid_barrier"}
    for name in term.force.kernels:
        assert hasattr(term.force._words, name.split(".")[1])
    assert term.force.sample_nodes == 8
    assert term.force.elastic
    assert 0 < term.force.bytes() < 14 * 8 * term.layout.rows * term.layout.columns
