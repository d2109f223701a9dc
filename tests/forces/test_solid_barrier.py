"""The barrier of solids against inversion: its formula in NumPy, invariants, and what it is there for."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from solids import AXES, SHAPES, BarrierEnergy, Term, bent, box, crumpled, squashed, stretched, volume_ratio
from surfaces import REALS, WIDTHS, noise, turned

from warpdeform.errors import InputError
from warpdeform.forces.solid_coefficients import refuse_inverted
from warpdeform.kernels.solid_volume import LEAST
from warpdeform.material import Material

Array = np.ndarray[Any, Any]

SMALL = (3, 2, 4)
STRENGTH = 2e4
PLAIN = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3)
GUARDED = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3, inversion_barrier=STRENGTH)
SOFT = Material(density=1000.0, youngs_modulus=1e-3, poisson_ratio=0.3, inversion_barrier=STRENGTH)
"""Nearly nothing but the barrier."""


def largest(a: Array) -> float:
    return float(np.abs(a).max())


@pytest.mark.parametrize("shape", ["box", "bent"])
@pytest.mark.parametrize("state", [crumpled, squashed])
def test_barrier_adds_energy_gradient_hessian_and_blocks_of_its_formula(shape: str, state: Any) -> None:
    rest = SHAPES[shape](SMALL)
    plain, guarded, formula = Term(rest, PLAIN), Term(rest, GUARDED), BarrierEnergy(rest.positions, STRENGTH)
    z = state(rest.positions)
    assert volume_ratio(z, rest.positions).min() < 0.9
    assert guarded.energy(z) == pytest.approx(plain.energy(z) + formula.energy(z).real, rel=1e-12)
    gradient = plain.gradient(z) + formula.gradient(z)
    assert largest(guarded.gradient(z) - gradient) < 1e-13 * largest(gradient)
    hessian, H = plain.dense() + formula.projected_hessian(z), guarded.dense()
    assert largest(formula.projected_hessian(z)) > 0.01 * largest(H)
    assert largest(H - hessian) < 1e-13 * largest(hessian)
    assert largest(H - H.T) < 1e-13 * largest(H)
    diagonal = np.einsum("ikil->ikl", H.reshape(24, 3, 24, 3)).reshape(*SMALL, 3, 3)
    assert largest(guarded.blocks() - diagonal) < 1e-13 * largest(diagonal)
    assert np.linalg.eigvalsh(H).min() > -1e-13 * largest(H)


@pytest.mark.parametrize("nodes", [(2, 2, 2), (3, 4, 17)], ids=str)
def test_gradient_is_the_difference_of_the_energy(nodes: tuple[int, int, int]) -> None:
    term = Term(bent(nodes), SOFT)
    z, step = squashed(term.rest), 1e-6
    gradient = term.gradient(z)
    for seed in range(3):
        p = noise(term.rest, 1.0, seed)
        slope = (term.energy(z + step * p) - term.energy(z - step * p)) / (2 * step)
        assert abs(np.sum(gradient * p) - slope) < 1e-6 * np.linalg.norm(gradient) * np.linalg.norm(p)


def test_nothing_is_felt_at_rest_nor_in_tension() -> None:
    rest = bent((3, 3, 4))
    plain, guarded = Term(rest, PLAIN), Term(rest, GUARDED)
    for z in (rest.positions, turned(rest.positions, (1, 2, 3), 0.7) + 0.3, stretched(rest.positions)):
        assert volume_ratio(z, rest.positions).min() > 1 - 1e-12
        assert guarded.energy(z) == pytest.approx(plain.energy(z), rel=1e-12, abs=1e-20)
        scale = largest(plain.gradient(stretched(rest.positions)))
        assert largest(guarded.gradient(z) - plain.gradient(z)) < 1e-14 * scale
        p = noise(rest.positions, 1.0)
        assert largest(guarded.product(p) - plain.product(p)) < 1e-12 * largest(plain.product(p))


@pytest.mark.parametrize("real", REALS)
def test_no_net_force_and_torque(real: Any) -> None:
    term = Term(bent((4, 3, 5)), SOFT, real)
    z = squashed(term.rest)
    force = term.gradient(z).astype(np.float64)
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    assert largest(force.sum(AXES)) < 4 * epsilon * np.abs(force).sum()
    torque = np.cross(z, force)
    assert largest(torque.sum(AXES)) < 8 * epsilon * np.abs(force).sum() * np.linalg.norm(np.ptp(z, axis=AXES))


@pytest.mark.parametrize("real", REALS)
def test_lane_widths_agree_to_the_bit_and_precisions_to_round_off(real: Any) -> None:
    rest = bent((3, 4, 18))
    z, p = squashed(rest.positions), noise(rest.positions, 1.0, 4)
    exact = Term(rest, GUARDED)
    narrow, wide = (Term(rest, GUARDED, real, width) for width in WIDTHS[real])
    for name, arguments in (("gradient", [z]), ("product", [p]), ("blocks", [])):
        values, other, expected = (getattr(term, name)(*arguments) for term in (narrow, wide, exact))
        np.testing.assert_array_equal(values, other, err_msg=name)
        np.testing.assert_allclose(values, expected, atol=1e-4 * largest(expected), err_msg=name)
    assert narrow.energy(z) == pytest.approx(wide.energy(z), rel=1e-13)
    assert narrow.energy(z) == pytest.approx(exact.energy(z), rel=1e-4)


@pytest.mark.parametrize("real", REALS)
def test_flat_and_inverted_cells_cost_infinitely_much_and_stay_finite_otherwise(real: Any) -> None:
    rest = box((3, 3, 3))
    term = Term(rest, GUARDED, real)
    flat, inverted, pushed = term.rest * [1, 1, 0.5 * LEAST], term.rest * [1, 1, -1], term.rest.copy()
    pushed[1, 1, 1] += 0.9
    for z in (flat, inverted, pushed, 0 * term.rest):
        assert volume_ratio(z, term.rest).min() <= LEAST
        assert term.energy(z) == np.inf
        assert np.isfinite(term.gradient(z)).all()
        assert np.isfinite(term.product(noise(term.rest, 1.0))).all()
        assert np.isfinite(term.blocks()).all()
    assert np.isfinite(term.energy(term.rest * [1, 1, 2 * LEAST]))


def test_places_without_a_cell_cost_nothing() -> None:
    term = Term(box((3, 3, 5)), GUARDED, wp.float32, 16)
    partials = wp.zeros((term.layout.rows, term.layout.columns), dtype=wp.float64, device="cpu")
    term.force.add_energy(None, term.upload(term.rest + 5.0), partials)
    assert np.isfinite(partials.numpy()).all()


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_stress_of_a_pressed_bar_rises_all_the_way(nu: float) -> None:
    """Without the barrier it falls again from a stretch of 1/sqrt 3 on, at -0.192 E (design 1.3)."""
    rest = box((2, 2, 2), (1.0, 1.0, 1.0))
    law = {"density": 1.0, "youngs_modulus": 1.0, "poisson_ratio": nu}
    plain, guarded = Term(rest, Material(**law)), Term(rest, Material(**law, inversion_barrier=0.05))

    def relaxed(stretch: float, term: Term) -> float:
        """Energy with free sides."""
        lateral, step = np.sqrt(1 + nu * (1 - stretch**2)), 1e-4
        for _ in range(50):
            low, middle, high = (
                term.energy(rest.positions * [stretch, side, side])
                for side in (lateral - step, lateral, lateral + step)
            )
            change = -0.5 * step * (high - low) / (high - 2 * middle + low)
            lateral += float(np.clip(change, -0.05, 0.05))
            if abs(change) < 1e-10:
                break
        return term.energy(rest.positions * [stretch, lateral, lateral])

    stretches = np.linspace(0.2, 0.95, 16)
    soft, stiff = (np.gradient([relaxed(s, term) for s in stretches], stretches) for term in (plain, guarded))
    assert soft.min() == pytest.approx(-0.192, abs=0.004)
    assert soft[0] > -0.15
    assert np.diff(stiff).min() > 0


def test_start_that_is_inverted_is_refused_with_its_cell() -> None:
    rest = box((4, 3, 5))
    refuse_inverted(rest.grid, rest.positions, squashed(rest.positions))
    pushed = rest.positions.copy()
    pushed[2, 1, 3] += [0.0, 0.0, 1.2]
    with pytest.raises(
        InputError, match=r"initial_positions = \[\d, \d, 3\]: has a cell that is flat or turned inside"
    ):
        refuse_inverted(rest.grid, rest.positions, pushed)


def test_solids_without_barrier_have_no_kernel_and_no_array_for_it() -> None:
    rest = box((9, 9, 16))
    plain, guarded = Term(rest, PLAIN, lane_width=8).force, Term(rest, GUARDED, lane_width=8).force
    assert not plain.barrier
    assert guarded.barrier
    assert "barrier" not in plain._words.module.name
    assert "barrier" in guarded._words.module.name
    place = plain.flux.capacity / plain.flux.shape[0]
    assert 3.9 * place < guarded.bytes() - plain.bytes() <= 4 * place
