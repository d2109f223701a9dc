"""The dropped block: its volume against closed forms, the engines at tiny size, verdicts."""

import math

import numpy as np
import pytest
from typer.testing import CliRunner

from warpdeform.cli import app
from warpdeform.study.peers import block_bench
from warpdeform.study.peers.block import Block, least_volume
from warpdeform.study.peers.block_bench import BlockTimes, bench_block
from warpdeform.study.peers.block_engines import BLOCK_ENGINES
from warpdeform.study.peers.block_worker import BlockAnswer, BlockJob, work


def grid(n: int, h: float) -> np.ndarray:
    """Positions of a cube of nodes, the axes along x, y and z."""
    return h * np.stack(np.meshgrid(*3 * [np.arange(n, dtype=float)], indexing="ij"), axis=-1)


def test_volume_is_that_of_the_worst_corner() -> None:
    x = grid(4, 0.5)
    assert least_volume(x, 0.5) == pytest.approx(1.0)
    assert least_volume(x @ np.diag([2.0, 0.5, 0.3]), 0.5) == pytest.approx(0.3)
    assert least_volume(x * [1.0, 1.0, -1.0], 0.5) == pytest.approx(-1.0)
    x[1, 2, 2, 2] += 0.4  # of 0.5: what is left of the edge above it is a fifth
    assert least_volume(x, 0.5) == pytest.approx(0.2)


def test_the_block_weighs_what_it_should() -> None:
    block = Block()
    assert block.mass == pytest.approx(8.0)
    assert block.spacing == pytest.approx(0.2 / 9)
    young = block.shear_modulus * (3 * block.first_lame + 2 * block.shear_modulus)
    assert young / (block.first_lame + block.shear_modulus) == pytest.approx(block.youngs_modulus)


@pytest.mark.parametrize("name", BLOCK_ENGINES)
def test_engines_drop_the_same_block(name: str) -> None:
    engine = BLOCK_ENGINES[name]
    if engine.missing:
        pytest.skip(f"{engine.package} is not installed")
    block = Block(nodes=4)
    session = engine.prepare(block, engine.settings[0].values)
    assert np.allclose(np.ptp(session.positions(), axis=(0, 1, 2)), block.side)
    assert least_volume(session.positions(), block.spacing) == pytest.approx(1.0, abs=1e-5)
    for _ in range(6):
        session.advance_frame()
    fallen = 0.1 - session.positions()[..., 2].min()
    assert fallen == pytest.approx(0.5 * 9.81 * 0.1**2, rel=0.2)


def test_this_engine_lands_and_stays_above_the_ground() -> None:
    answer = work(BlockJob("ours", {}, 4, 0.5))
    assert answer.trouble == ""
    assert 0.0 < answer.lowest_m < 0.002
    assert 0.5 < answer.least_volume < 1.0
    assert answer.height_m == pytest.approx(0.2, rel=0.1)


def test_verdicts_compare_with_the_rival(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = {"ours": BlockAnswer(1.0, 1e-3, 1e-3, 0.2, 0.9), "mujoco": BlockAnswer(4.0, -0.01, -0.001, 0.2, 0.8)}
    monkeypatch.setattr(block_bench, "BLOCK_ENGINES", {"ours": BLOCK_ENGINES["ours"]})
    monkeypatch.setattr(block_bench, "_answer", lambda job: answers[job.engine])
    times = bench_block(4, repeats=1)
    (depth,) = times.targets
    assert depth.met
    rival = block_bench.BlockRun("mujoco", "4", "dt", True, answers["mujoco"])
    share, _ = block_bench._targets((*times.runs, rival))
    assert share.value == pytest.approx(0.25)
    assert not share.met
    assert any("times ours" in line for line in BlockTimes({}, 0, Block(), times.runs, {}, times.targets).lines())


def test_a_failing_engine_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = block_bench._answer(BlockJob("nobody", {}, 4, 0.1))
    assert math.isnan(answer.cpu_s_per_s)
    assert "nobody" in answer.trouble


def test_the_command_prints_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_bench, "BLOCK_ENGINES", {"ours": BLOCK_ENGINES["ours"]})
    result = CliRunner().invoke(app, ["bench", "block", "--size", "4", "--duration", "0.05", "--repeats", "1"])
    assert result.exit_code == 0, result.output
    assert "| ours, dt 1/60, 1 Newton *" in result.stdout
