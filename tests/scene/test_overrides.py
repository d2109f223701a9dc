"""Values from the command line reach their key, or are refused with a suggestion."""

from typing import Any

import pytest

from warpdeform.errors import InputError
from warpdeform.scene.overrides import Override, apply_overrides, parse_override


def tables() -> dict[str, Any]:
    return {
        "scene": {"fps": 60},
        "body": [
            {"nodes": [5, 4], "shape": {"kind": "sheet"}, "material": "cotton", "pins": ["corner:0,0", [[1, 1]]]},
            {"nodes": [5, 4], "shape": {"kind": "arc"}, "material": {"eta": 1.0}},
        ],
        "obstacle": [{"kind": "sphere", "radius": 0.3}],
    }


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("body.0.nodes=[33,33]", "body.0.nodes", [33, 33]),
        ("solver.precision=float64", "solver.precision", "float64"),
        ('solver.precision="float64"', "solver.precision", "float64"),
        ("scene.fps = 30", "scene.fps", 30),
        ("scene.fps=1e3", "scene.fps", 1000.0),
        ("scene.name=a=b", "scene.name", "a=b"),
        ("scene.name=", "scene.name", ""),
        ("body.0.pins=['edge:u,0', [[1, 2]]]", "body.0.pins", ["edge:u,0", [[1, 2]]]),
        ("scene.name=1\nx=2", "scene.name", "1\nx=2"),
    ],
)
def test_a_value_is_toml_or_else_text(text: str, key: str, value: object) -> None:
    override = parse_override(text)
    assert (override.key, override.value, override.source) == (key, value, "--set")


@pytest.mark.parametrize("text", ["scene.fps", "=3", " = 3"])
def test_what_is_no_assignment_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"is no assignment\. Use KEY=VALUE"):
        parse_override(text)


@pytest.mark.parametrize(
    ("key", "found"),
    [
        ("scene.fps", lambda t: t["scene"]["fps"]),
        ("solver.substeps", lambda t: t["solver"]["substeps"]),
        ("wind.velocity", lambda t: t["wind"]["velocity"]),
        ("body.1.nodes", lambda t: t["body"][1]["nodes"]),
        ("body.0.nodes.1", lambda t: t["body"][0]["nodes"][1]),
        ("body.0.material", lambda t: t["body"][0]["material"]),
        ("body.1.shape.radius", lambda t: t["body"][1]["shape"]["radius"]),
        ("body.0.pins.1", lambda t: t["body"][0]["pins"][1]),
        ("obstacle.0.path.spin", lambda t: t["obstacle"][0]["path"]["spin"]),
    ],
)
def test_a_value_reaches_its_key(key: str, found: Any) -> None:
    raw = tables()
    sources, mistakes = apply_overrides(raw, [Override(key, 7, "--set")])
    assert not mistakes
    assert found(raw) == 7
    assert list(sources.values()) == ["--set"]


def test_a_short_form_becomes_a_table_when_a_key_of_it_is_set() -> None:
    raw = tables()
    overrides = [
        Override("body.0.material.thickness", 0.002),
        Override("body.0.pins.0.path.times", [0.0, 1.0]),
        Override("body.0.pins.1.path.times", [0.0, 2.0]),
    ]
    _, mistakes = apply_overrides(raw, overrides)
    assert not mistakes
    assert raw["body"][0]["material"] == {"preset": "cotton", "thickness": 0.002}
    assert raw["body"][0]["pins"][0] == {"nodes": "corner:0,0", "path": {"times": [0.0, 1.0]}}
    assert raw["body"][0]["pins"][1] == {"nodes": [[1, 1]], "path": {"times": [0.0, 2.0]}}


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("scene.fsp", 'scene has no key "fsp". Did you mean "fps"?'),
        ("scen.fps", 'the scene has no key "scen". Did you mean "scene"?'),
        ("body.0.material.thicknes", 'body.0.material has no key "thicknes". Did you mean "thickness"?'),
        ("obstacle.0.height", 'obstacle.0 has no key "height". Its keys are name, position'),
        ("body.2.nodes", "2 is not an index of body. Use 0 to 1."),
        ("obstacle.1.radius", "1 is not an index of obstacle. Use 0."),
        ("body.-1.nodes", "-1 is not an index of body"),
        ("body.sheet.nodes", "sheet is not an index of body"),
        ("body.0.springs.0.stiffness", "body.0.springs is empty. Add it to the scene file first."),
        ("scene.fps.x", "scene.fps is a single value without keys. Set scene.fps itself."),
        ("", 'the scene has no key ""'),
    ],
)
def test_a_key_that_does_not_exist_is_refused(key: str, words: str) -> None:
    raw = tables()
    _, mistakes = apply_overrides(raw, [Override(key, 7, "--set")])
    (mistake,) = mistakes
    assert words in str(mistake)
    assert str(mistake).startswith(f"--set: {key}")


def test_values_that_are_given_stay_as_they_are() -> None:
    bodies = [{"nodes": [3, 3]}]
    raw: dict[str, object] = {}
    apply_overrides(raw, [Override("body", bodies), Override("body.0.nodes", [5, 5])])
    assert raw["body"] == [{"nodes": [5, 5]}]
    assert bodies == [{"nodes": [3, 3]}]
