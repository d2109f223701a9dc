"""What the benchmarks count of a kernel's source is what the compiled kernel does."""

from collections.abc import Iterator

import numpy as np
import pytest
import warp as wp

from warpdeform.grid import Layout, ParameterGrid
from warpdeform.kernels.krylov import krylov
from warpdeform.kernels.lanes import kernel_module
from warpdeform.kernels.multigrid import multigrid
from warpdeform.linear.transfer import Transfer
from warpdeform.scene import Override, load_scene
from warpdeform.study.bench.counting import Launch, count, recorded_launches
from warpdeform.study.bench.interpreter import UncountableError, run_thread
from warpdeform.study.bench.passes import PASSES, YARDSTICK, Pass, Sheet
from warpdeform.study.bench.run_traffic import run_traffic

CPU = wp.get_device("cpu")
MARK = 12345.0


def launches_of(each: Pass, sheet: Sheet) -> list[Launch]:
    with recorded_launches() as launches:
        each.launch(sheet)
    return launches


def different_launches(sheet: Sheet) -> dict[str, Launch]:
    """One launch of every kernel of the passes; those of membranes alone are kernels of their own."""
    every = (launch for each in PASSES for launch in launches_of(each, sheet))
    return {f"{launch.kernel.module.name}.{launch.kernel.key}": launch for launch in every}


def arrays_of(launch: Launch) -> list[wp.array]:
    """The arrays among the arguments, members of structs included."""
    found: list[wp.array] = []
    for argument in launch.arguments:
        members = argument._cls.vars if hasattr(argument, "_cls") else ()
        found += [getattr(argument, name) for name in members]
        found += [argument] if isinstance(argument, wp.array) else []
    return [a for a in found if isinstance(a, wp.array)]


def planes(launch: Launch) -> Iterator[tuple[int, int]]:
    """Every component of every array that goes by lane groups: argument and component."""
    for position, a in enumerate(arrays_of(launch)):
        if a.ndim == 3 and min(a.shape[1:]) > 1:
            yield from ((position, component) for component in range(a.shape[0]))


def test_components_are_those_that_the_compiled_kernels_touch() -> None:
    """A mark that a launch replaces was written; a NaN that shows up in what it wrote was read."""
    sheet = Sheet(18, "float32", 16, CPU)
    inside = np.s_[1:-1, 16:-16]
    launches = different_launches(sheet)
    assert len(launches) >= 17
    for name, launch in launches.items():
        given = arrays_of(launch)
        arrays = {position: given[position].numpy() for position, _ in planes(launch)}
        kept = {position: a.copy() for position, a in arrays.items()}
        cells = [a.numpy() for a in given if a.dtype == wp.float64]
        kept_cells = [a.copy() for a in cells]

        def rerun(launch: Launch = launch) -> None:
            wp.launch(launch.kernel, dim=launch.threads, inputs=list(launch.arguments), device="cpu")

        def restore(
            arrays: dict[int, np.ndarray] = arrays,
            kept: dict[int, np.ndarray] = kept,
            cells: list[np.ndarray] = cells,
            kept_cells: list[np.ndarray] = kept_cells,
        ) -> None:
            for position, a in arrays.items():
                a[:] = kept[position]
            for a, before in zip(cells, kept_cells, strict=True):
                a[:] = before

        written, read = set(), set()
        for position, component in planes(launch):
            arrays[position][component] = MARK
            rerun()
            if np.any(arrays[position][component][inside] != MARK):
                written.add((position, component))
            restore()
        for position, component in planes(launch):
            arrays[position][component] = np.nan
            rerun()
            results = [arrays[p][c][inside] for p, c in written]
            if any(np.isnan(a).any() for a in (*results, *cells)):
                read.add((position, component))
            restore()
        thread = run_thread(launch.kernel, launch.threads, launch.arguments)
        positions = [next(k for k, a in enumerate(given) if a is met) for met in thread.arrays]
        for found, expected in ((thread.read, read), (thread.written, written)):
            assert {(positions[place], c) for place, c in found} & set(planes(launch)) == expected, name


def test_yardstick_by_hand() -> None:
    sheet = Sheet(16, "float32", 16, CPU)
    work = count(launches_of(next(each for each in PASSES if each.name == YARDSTICK), sheet))
    # Four edges 6 each, two pulls 6, two fluxes along 9, four means 12, the shear 12 and its two fluxes 3.
    assert work.flops / 256 == 4 * 6 + 2 * 6 + 2 * 9 + 4 * 12 + 12 + 2 * 3
    assert work.bytes / 256 == 4 * (3 + 3 + 5 + 6 + 6)
    assert work.working_set == work.bytes


@pytest.mark.parametrize(("width", "partial"), [(1, 8.0), (8, 8.0), (16, 4.0)])
def test_partial_sums_cost_a_cache_line(width: int, partial: float) -> None:
    sheet = Sheet(32, "float32", width, CPU)
    state = sheet.state
    launch = Launch(krylov(width, wp.float32).dot, sheet.dim, (sheet.p, sheet.q, state.dots))
    work = count([launch])
    assert work.bytes / 1024 == pytest.approx(24 + partial)
    assert work.flops / 1024 == pytest.approx(5 + (width - 1) / width)


def test_arrays_of_several_launches_count_in_each_and_once_in_the_working_set() -> None:
    sheet = Sheet(16, "float32", 16, CPU)
    copy = krylov(16, wp.float32).copy
    work = count([Launch(copy, sheet.dim, (sheet.p, sheet.q)), Launch(copy, sheet.dim, (sheet.q, sheet.p))])
    assert work.bytes / 256 == 48
    assert work.working_set / 256 == 24


def test_numbers_per_row_count_by_their_arrays() -> None:
    sheet = Sheet(16, "float32", 16, CPU)
    work = count(launches_of(next(each for each in PASSES if each.name == "bending nodes"), sheet))
    assert work.bytes / 256 == pytest.approx(4 * (3 + 3 + 7 + 4), rel=0.05)


def test_recorded_launches_do_not_run() -> None:
    sheet = Sheet(9, "float32", 16, CPU)
    before, launch = sheet.sum.numpy().copy(), wp.launch
    for each in PASSES:
        launches_of(each, sheet)
    np.testing.assert_array_equal(sheet.sum.numpy(), before)
    assert wp.launch is launch


def test_what_cannot_be_counted_is_refused() -> None:
    module = kernel_module("uncountable", 1, wp.float32)

    @wp.kernel(module=module)
    def loop(a: wp.array(dtype=wp.float32)):
        for k in range(int(a[0])):
            a[k] = 1.0

    launch = Launch(loop, (2,), (wp.zeros(4, dtype=wp.float32, device="cpu"),))
    with pytest.raises(UncountableError, match="loop cannot be counted"):
        count([launch])


def test_picked_entries_count_as_the_whole_component() -> None:
    """Restriction reads a whole fine vector, not as many entries as it writes."""
    grids = [ParameterGrid((n, n), (1.0 / (n - 1), 1.0 / (n - 1))) for n in (65, 33)]
    fine_layout = Layout((65, 65), 16)
    transfer = Transfer(grids[0], fine_layout, grids[1], wp.float32, CPU)
    fine, coarse = (
        wp.zeros((3, layout.rows, layout.columns), dtype=wp.float32, device=CPU)
        for layout in (fine_layout, transfer.layout)
    )
    carry = multigrid(16, wp.float32).carry
    tables = transfer.restrict
    lists = sum(a.size * 4 for a in (tables.rows, tables.row_weights, tables.columns, tables.column_weights))
    down = count([Launch(carry, transfer.layout.lane_dim, (fine, tables.of_rows(0, 33), coarse))])
    expected = 4 * 3 * (65 * 80 + 33 * 48)
    assert expected < down.bytes <= expected + lists
    up = count([Launch(carry, fine_layout.lane_dim, (coarse, transfer.prolong.of_rows(0, 65), fine))])
    assert up.bytes == pytest.approx(expected, rel=0.1)
    assert up.working_set == up.bytes


@pytest.mark.parametrize("preconditioner", ["block-jacobi", "multigrid"])
def test_traffic_of_a_run_is_that_of_its_iterations(preconditioner: str) -> None:
    nodes = 33

    def traffic(iterations: int) -> float:
        overrides = {
            "body.0.nodes": [nodes, nodes],
            "solver.device": "cpu",
            "solver.preconditioner": preconditioner,
            "solver.newton_iterations": 1,
            "solver.cg_tolerance": 1e-7,
            "solver.cg_iterations": iterations,
        }
        found = run_traffic(load_scene("hanging", [Override(key, value) for key, value in overrides.items()]), 1)
        assert found is not None
        return found

    one, two, three = (traffic(iterations) for iterations in (1, 2, 3))
    assert three - two == two - one
    iteration = next(each for each in PASSES if each.name.startswith("CG iteration"))
    timed = count(launches_of(iteration, Sheet(nodes, "float32", 16, CPU))).bytes
    if preconditioner == "block-jacobi":
        assert two - one == timed
    else:
        assert two - one > 2 * timed


def test_runs_with_obstacles_are_not_counted() -> None:
    overrides = {"body.0.nodes": [5, 5], "solver.device": "cpu"}
    assert run_traffic(load_scene("carpet", [Override(key, value) for key, value in overrides.items()]), 1) is None
