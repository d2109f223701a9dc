"""The measures of the scenes' claims, on things whose depth is known."""

import numpy as np
import pytest

from warpdeform.body import Body
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.scene.checks import Claim
from warpdeform.scene.measure import asymmetry, capsule_gaps, depth, load_on_sphere, relative_volumes, samples
from warpdeform.settings import Settings
from warpdeform.shape import block, sheet
from warpdeform.simulation import Simulation
from warpdeform.track import Track, rotation_to


@pytest.mark.parametrize(
    ("obstacle", "point", "expected"),
    [
        (Obstacle("plane"), (3.0, 4.0, -0.2), 0.2),
        (Obstacle("plane"), (3.0, 4.0, 0.2), 0.0),
        (Obstacle("plane", track=Track.fixed((0, 0, 1), tuple(rotation_to((1, 0, 0))))), (-0.3, 9.0, 9.0), 0.3),
        (Obstacle("sphere", {"radius": 0.5}), (0.3, 0.0, 0.0), 0.2),
        (Obstacle("sphere", {"radius": 0.5}, track=Track.line((0, 0, 0), (2, 0, 0), 0.0, 1.0)), (1.6, 0, 0), 0.0),
        (Obstacle("cylinder", {"radius": 0.5, "height": 2.0}), (0.1, 0.0, 0.9), 0.1),
        (Obstacle("cylinder", {"radius": 0.5, "height": 2.0}), (0.4, 0.0, 0.0), 0.1),
        (Obstacle("cylinder", {"radius": 0.5, "height": 2.0}), (0.0, 0.0, 1.1), 0.0),
        (Obstacle("capsule", {"radius": 0.5, "height": 2.0}), (0.0, 0.0, 1.1), 0.4),
        (Obstacle("capsule", {"radius": 0.5, "height": 2.0}), (0.3, 0.0, -0.7), 0.2),
        (Obstacle("capsule", {"radius": 0.5, "height": 2.0}), (0.4, 0.0, 1.4), 0.0),
    ],
)
def test_depth_in_primitives(obstacle: Obstacle, point: tuple[float, ...], expected: float) -> None:
    assert depth(obstacle, np.array([point]), 0.0) == pytest.approx(expected)


def test_gaps_are_those_to_the_nearest_capsule() -> None:
    across = Track.fixed((0.0, 0.0, 3.0), tuple(rotation_to((1, 0, 0))))
    arms = [Obstacle("capsule", {"radius": 0.5, "height": 2.0}, track=track) for track in (Track.fixed(), across)]
    points = np.array([[2.0, 0.0, 0.0], [3.0, 0.0, 3.0], [0.0, 0.0, 2.4], [0.2, 0.0, 0.5]])
    np.testing.assert_allclose(capsule_gaps(arms, points, 0.0), [1.5, 1.5, 0.1, -0.3], atol=1e-12)


def test_depth_in_a_mesh_is_that_in_the_box_it_draws() -> None:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    box = Obstacle("mesh", vertices=corners, faces=faces)
    random = np.random.default_rng(0)
    for point in random.uniform(-0.5, 1.5, (300, 3)):
        inside = float(np.min(np.minimum(point, 1.0 - point)))
        assert depth(box, point[None], 0.0) == pytest.approx(max(inside, 0.0), abs=1e-9)


def test_samples_are_nodes_edges_and_cells() -> None:
    u, v = np.meshgrid(np.arange(3.0), np.arange(2.0), indexing="ij")
    points = samples(np.stack([u, v, 0 * u], axis=-1))
    assert len(points) == 6 + 4 + 3 + 2
    assert {(0.5, 0.5), (1.5, 0.5), (0.5, 1.0), (2.0, 0.5)} <= {(x, y) for x, y, _ in points}


def test_asymmetry_is_zero_of_a_symmetric_sheet_only() -> None:
    u, v = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(0, 1, 4), indexing="ij")
    sheet = np.stack([u, v, u**2], axis=-1)
    assert asymmetry(sheet, axis=0, across=0) == 0.0
    sheet[0, 0, 2] += 0.25
    assert asymmetry(sheet, axis=0, across=0) == 0.25


@pytest.mark.parametrize(("value", "holds"), [(0.5, True), (1.0, True), (1.1, False), (-0.1, False), (np.nan, False)])
def test_a_claim_holds_within_its_bounds(value: float, holds: bool) -> None:
    assert Claim("it", value, 0.0, 1.0).holds is holds


def test_volumes_of_cells_have_a_sign() -> None:
    rest = block((3, 4, 3), (0.2, 0.3, 0.2)).positions
    np.testing.assert_allclose(relative_volumes(rest @ np.diag([2.0, 1.5, 0.5]), rest), 1.5)
    np.testing.assert_allclose(relative_volumes(rest * [1.0, 1.0, -1.0], rest), -1.0)
    pushed = rest.copy()
    pushed[1, 1, 2] -= [0.0, 0.0, 0.25]
    found = relative_volumes(pushed, rest)
    assert found.shape == (2, 3, 2)
    assert (found[:, :2, 1] < 0.75).all()
    np.testing.assert_allclose(found[:, 2], 1.0)


@pytest.mark.parametrize("height", [0.1003, 0.0998])
def test_load_on_a_sphere_is_what_its_field_does(height: float) -> None:
    # One node below the sphere, outside of it and inside: the slope of the energy that the engine has there.
    ball = Obstacle("sphere", {"radius": 0.1}, design_speed=2.0, track=Track.fixed((0.0, 0.0, 0.3)))
    positions = np.array([[[0.0, 0.0, 0.3 - height], [0.0, 0.0, -1.0]], [[0.0, 0.0, -2.0], [0.0, 0.0, -3.0]]])
    body = Body("sheet", sheet((2, 2)), Material.preset("cotton"), initial_positions=positions)
    settings = Settings(precision="float64", device="cpu")
    handle = Simulation([body], obstacles=[ball], settings=settings)["sheet"]
    (term,) = (each for each in handle.terms if each.name == "obstacles")
    gradient = handle.model.zeros(3)
    term.linearise(handle.state, handle.state.x)
    term.add_gradient(handle.state, handle.state.x, gradient)
    pressed = np.sum(handle.model.download(gradient), axis=(0, 1))
    mass = np.asarray(handle.model.node_mass)
    found = load_on_sphere(ball, positions.reshape(-1, 3), mass.reshape(-1), 0.0, settings.gravity)
    assert pressed[2] > 1.0
    np.testing.assert_allclose(found, pressed, rtol=1e-9)
