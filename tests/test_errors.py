"""The sentences that users read when something is wrong."""

import numpy as np
import pytest

from warpdeform.errors import InputError, Mistake, SimulationFailure, WarpdeformError

POISSON = Mistake("body.0.material.poisson_ratio", 0.7, "must be below 0.5", "Use 0 to 0.49.", "scene.toml")
MISSING = Mistake("body.0.nodes", None, "is missing", "Use for example [64, 64].")


def test_a_mistake_is_one_line_with_file_key_value_and_remedy() -> None:
    line = "scene.toml: body.0.material.poisson_ratio = 0.7: must be below 0.5. Use 0 to 0.49."
    assert str(POISSON) == line
    assert str(MISSING) == "body.0.nodes: is missing. Use for example [64, 64]."


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("cotton", 'key = "cotton": '),
        (True, "key = true: "),
        ((1, 5), "key = [1, 5]: "),
        (np.array([1.0, np.nan]), "key = [1.0, nan]: "),
        (np.float64(2.5), "key = 2.5: "),
        ("two\nlines", 'key = "two lines": '),
    ],
)
def test_values_read_as_the_user_wrote_them(value: object, text: str) -> None:
    assert str(Mistake("key", value, "is bad", "Change it.")).startswith(text)


def test_long_values_are_cut() -> None:
    line = str(Mistake("key", list(range(1000)), "is bad", "Change it."))
    assert len(line) < 120
    assert "..." in line


def test_input_error_says_every_mistake() -> None:
    error = InputError([POISSON, MISSING])
    assert error.mistakes == (POISSON, MISSING)
    assert str(error).splitlines() == [str(POISSON), str(MISSING)]
    assert InputError(POISSON).mistakes == (POISSON,)
    with pytest.raises(ValueError, match="at least one mistake"):
        InputError([])


def test_simulation_failure_says_where_when_and_what_to_do() -> None:
    failure = SimulationFailure("sheet", 0.25, (3, 4), "positions are no longer finite", "Use more substeps.")
    assert isinstance(failure, WarpdeformError)
    assert failure.node == (3, 4)
    assert str(failure) == ('body "sheet", node [3, 4], t = 0.25 s: positions are no longer finite. Use more substeps.')
    assert "node" not in str(SimulationFailure("sheet", 0.25, (), "stopped", "Use more substeps."))
