import numpy as np
import pytest

from warpdeform.errors import InputError
from warpdeform.track import Track, multiply, rotation_matrix, rotation_to, to_rotation_vector

QUARTER_Z = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))


def test_a_fixed_track_stays() -> None:
    track = Track.fixed((1.0, 2.0, 3.0), QUARTER_Z)
    assert track.static
    assert track.max_speed(5.0) == 0.0
    for time in (-1.0, 0.0, 7.0):
        position, rotation = track.pose(time)
        np.testing.assert_array_equal(position, (1.0, 2.0, 3.0))
        np.testing.assert_allclose(rotation, QUARTER_Z)


def test_keyframes_are_met_and_the_way_between_is_straight() -> None:
    track = Track([1.0, 2.0, 4.0], [[0, 0, 0], [1, 0, 0], [1, 4, 0]])
    assert not track.static
    for time, place in ((0.0, (0, 0, 0)), (1.5, (0.5, 0, 0)), (2.0, (1, 0, 0)), (3.0, (1, 2, 0)), (9.0, (1, 4, 0))):
        np.testing.assert_allclose(track.pose(time)[0], place, atol=1e-15)
    assert track.max_speed(1.0) == pytest.approx(2.0)


def test_rotation_takes_the_shorter_way_at_constant_rate() -> None:
    opposite = tuple(-x for x in QUARTER_Z)
    for end in (QUARTER_Z, opposite):
        track = Track([0.0, 1.0], np.zeros((2, 3)), [[0, 0, 0, 1], end])
        vector = to_rotation_vector(track.pose(0.3)[1])
        np.testing.assert_allclose(vector, [0, 0, 0.3 * np.pi / 2], atol=1e-14)


def test_spin_turns_about_world_axes_after_the_keyframes() -> None:
    track = Track([1.0], [[0, 0, 0]], [QUARTER_Z], spin=(np.pi, 0.0, 0.0))
    expected = rotation_matrix(multiply(np.array([1.0, 0, 0, 0]), np.array(QUARTER_Z)))
    np.testing.assert_allclose(rotation_matrix(track.pose(2.0)[1]), expected, atol=1e-14)
    np.testing.assert_allclose(track.pose(0.0)[1], QUARTER_Z)
    assert track.max_speed(2.0) == pytest.approx(2 * np.pi)


def test_rotation_leaves_the_pivot_where_it_is() -> None:
    pivot = np.array([0.5, -0.2, 0.1])
    track = Track([0.0], [[1.0, 2.0, 3.0]], spin=(0.3, 1.0, -2.0), pivot=pivot)
    for time in (0.0, 0.4, 2.0):
        position, rotation = track.pose(time)
        np.testing.assert_allclose(position + rotation_matrix(rotation) @ pivot, [1.5, 1.8, 3.1], atol=1e-14)


def test_a_pose_belongs_to_the_caller() -> None:
    track = Track.fixed((1.0, 2.0, 3.0))
    track.pose(0.0)[0][0] = 7.0
    assert track.pose(0.0)[0][0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        track.positions[0, 0] = 2.0


@pytest.mark.parametrize("normal", [(0, 0, 2), (0, 0, -1), (1, 2, 3), (-1, 1e-9, 0)])
def test_rotation_to_turns_z_to_the_normal(normal: tuple[float, float, float]) -> None:
    quaternion = rotation_to(normal)
    assert np.linalg.norm(quaternion) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation_matrix(quaternion)[:, 2], np.array(normal) / np.linalg.norm(normal), atol=1e-9)


@pytest.mark.parametrize(
    ("words", "key"),
    [
        ({"times": [0.0, 0.0], "positions": np.zeros((2, 3))}, "times"),
        ({"times": [], "positions": np.zeros((0, 3))}, "times"),
        ({"times": [0.0], "positions": [[0, 0]]}, "positions"),
        ({"times": [0.0, 1.0], "positions": [[0, 0, 0]]}, "positions"),
        ({"times": [0.0], "positions": [[0, 0, float("nan")]]}, "positions"),
        ({"times": [0.0], "positions": [["a", 0, 0]]}, "positions"),
        ({"times": [0.0], "positions": [[0, 0, 0]], "rotations": [[0, 0, 0, 0]]}, "rotations"),
        ({"times": [0.0], "positions": [[0, 0, 0]], "spin": [0, 1]}, "spin"),
        ({"times": [0.0], "positions": [[0, 0, 0]], "pivot": [0, 1, float("inf")]}, "pivot"),
    ],
)
def test_refused_tracks_name_the_key(words: dict[str, object], key: str) -> None:
    with pytest.raises(InputError) as refused:
        Track(**words)  # type: ignore[arg-type]
    assert key in [mistake.key for mistake in refused.value.mistakes]


def test_a_normal_of_length_zero_is_refused() -> None:
    with pytest.raises(InputError, match="normal"):
        rotation_to((0.0, 0.0, 0.0))
