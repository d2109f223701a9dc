"""A scene becomes frames: all of them, or those until it was stopped or failed."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from warpdeform.errors import InputError, SimulationFailure
from warpdeform.scene import BuiltScene, load_scene
from warpdeform.scene.play import play
from warpdeform.simulation import Simulation

COARSE = {"body.0.nodes": [7, 6], "solver.device": "cpu"}


def coarse(frames: int = 5, **more: object) -> BuiltScene:
    return load_scene("hanging", {**COARSE, **more}, frames=frames)


def test_every_frame_is_shown_and_written(tmp_path: Path) -> None:
    times = []
    played = play(coarse(), tmp_path / "out.usda", on_frame=lambda simulation: times.append(simulation.time))
    np.testing.assert_allclose(times, np.arange(5) / 60)
    record = played.record
    assert (record.frames, record.nodes, record.output) == (5, 42, str(tmp_path / "out.usda"))
    assert record.sim_s == pytest.approx(4 / 60)
    assert record.wall_s > 0
    assert not played.interrupted
    assert played.failure is None
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 5)
    data = stage.GetRootLayer().customLayerData["warpdeform"]
    assert data["scene"] == "hanging"
    assert data["statistics"]["newton_iterations"] == record.newton_iterations


def test_one_sample_is_the_initial_state(tmp_path: Path) -> None:
    played = play(coarse(frames=1), tmp_path / "one.usdc")
    assert (played.record.frames, played.record.newton_iterations) == (1, 0)
    stage = Usd.Stage.Open(str(tmp_path / "one.usdc"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/sheet"))
    points = np.array(mesh.GetPointsAttr().Get(1)).reshape(7, 6, 3)
    np.testing.assert_allclose(points, load_scene("hanging", COARSE).bodies[0].placed_positions(), atol=1e-6)


def test_units_and_axis_of_the_scene_reach_the_file(tmp_path: Path) -> None:
    scene = coarse(2, **{"scene.meters_per_unit": 0.01, "scene.up_axis": "Y"})
    play(scene, tmp_path / "out.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/World/sheet")).GetPointsAttr().Get(1))
    assert np.ptp(points[:, 0]) == pytest.approx(100.0, rel=1e-5)


def test_a_run_can_be_stopped(tmp_path: Path) -> None:
    frames: list[int] = []
    played = play(
        coarse(),
        tmp_path / "out.usdc",
        on_frame=lambda simulation: frames.append(simulation.frame),
        stopped=lambda: len(frames) == 3,
    )
    assert played.interrupted
    assert played.record.frames == 3
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert stage.GetEndTimeCode() == 3
    assert stage.GetRootLayer().customLayerData["warpdeform"]["state"] == "interrupted"


def test_a_run_asked_to_stop_at_its_last_frame_is_complete() -> None:
    assert not play(coarse(frames=2), stopped=lambda: False).interrupted
    assert not play(coarse(frames=1), stopped=lambda: True).interrupted


def test_a_failure_keeps_the_frames_until_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    advance = Simulation.advance_frame

    def failing(simulation: Simulation) -> None:
        if simulation.frame == 2:
            raise SimulationFailure("sheet", simulation.time, (1, 2), "it tore", "Use less.")
        advance(simulation)

    monkeypatch.setattr(Simulation, "advance_frame", failing)
    played = play(coarse(), tmp_path / "out.usdc")
    assert isinstance(played.failure, SimulationFailure)
    assert played.record.frames == 3
    assert Usd.Stage.Open(str(tmp_path / "out.usdc")).GetEndTimeCode() == 3


def test_a_bad_output_is_refused_before_anything_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("warpdeform.scene.play.simulation_of", lambda scene: pytest.fail("it was built"))
    with pytest.raises(InputError, match=r"has the suffix \.mp4"):
        play(coarse(), "flag.mp4")


def test_crossings_are_counted_on_request() -> None:
    scene = load_scene("crumple", {"solver.device": "cpu", "body.0.nodes": [9, 9], "contact.0.gap": 0.01}, frames=3)
    for counted, crossings in ((True, [0, 0]), (False, None)):
        contact = play(scene, counted=counted).record.contact
        assert contact is not None
        assert contact.crossings == crossings
        assert contact.as_dict()["crossings"] == crossings
