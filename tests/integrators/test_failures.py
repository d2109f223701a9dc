"""Steps that fail: repeated in halves from the last good state, counted, and given up with a reason; adaptive steps."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import CLOTH, PRECISE, REAL_TIME, SEARCHING, assert_same_bits, busy, hanging, run

from warpdeform.body import Pin
from warpdeform.errors import InputError, SimulationFailure
from warpdeform.material import Material
from warpdeform.result import ORDINARY, REMEDIES, Outcome, RunRecord, StepRecord, joined
from warpdeform.settings import Settings
from warpdeform.shape import sheet
from warpdeform.simulation import Simulation

Array = np.ndarray[Any, Any]


def hurried(integrator: str, iterations: int, **settings: Any) -> Simulation:
    """A sheet whose Newton iteration must converge and may not take long."""
    options = {"integrator": integrator, "fps": 10.0} | settings
    simulation = Simulation([hanging((7, 7))], settings=replace(PRECISE, **options))
    stepper: Any = simulation._stepper
    stepper._settled[0] = iterations
    stepper.reset()
    return simulation


@pytest.mark.parametrize("integrator", SEARCHING)
def test_steps_that_do_not_converge_are_repeated_in_halves(integrator: str) -> None:
    simulation = hurried(integrator, 12)
    for frame in range(1, 6):
        report = simulation.step()
        assert report.completed
        assert simulation.time == pytest.approx(0.1 * frame, abs=1e-15)
    record = simulation.record()
    assert record.retries > 2
    assert record.steps > 5
    assert record.outcomes["capped"] == record.retries == record.newton_unconverged
    assert record.outcomes["converged"] + record.outcomes.get("round_off", 0) == record.steps
    # What was repeated left no trace: the run is as good as one of short steps.
    fine = Simulation([hanging((7, 7))], settings=replace(PRECISE, integrator="tr-bdf2", fps=320.0))
    for _ in range(160):
        fine.step()
    off = float(np.abs(simulation["sheet"].positions() - fine["sheet"].positions()).max())
    assert off < (0.3 if integrator == "implicit-euler" else 0.2)


@pytest.mark.parametrize("integrator", SEARCHING)
def test_steps_that_never_converge_end_the_run_and_leave_the_state(integrator: str) -> None:
    simulation = hurried(integrator, 12)
    simulation.step()
    before, time = run(simulation, 0), simulation.time
    stepper: Any = simulation._stepper
    stepper._settled[0] = 1
    with pytest.raises(SimulationFailure) as error:
        simulation.step()
    assert (error.value.body, error.value.time) == ("sheet", time)
    assert len(error.value.node) == 2
    assert "a step of 0.00156 s could not be completed: newton reached its cap" in str(error.value)
    assert REMEDIES[Outcome.CAPPED] in str(error.value)
    assert_same_bits(run(simulation, 0), before)
    # It goes on once it may.
    stepper._settled[0] = 40
    simulation.step()
    assert simulation.time > time


def test_a_repeated_step_keeps_the_anchors_and_frames_of_the_last_good_state() -> None:
    # Friction, wind and everything else: a step that fails and is repeated whole is the step that would have been.
    settings: dict[str, Any] = {"integrator": "implicit-euler", "newton_iterations": 0, "newton_tolerance": 1e-6}
    plain, disturbed = busy(**settings), busy(**settings)
    run(plain, 8)
    run(disturbed, 8)
    stepper: Any = disturbed._stepper
    stepper._settled[0], cap = 1, stepper._settled[0]
    stepper._attempt(disturbed.time, disturbed.time + disturbed.dt, disturbed.dt, disturbed._replay)
    stepper._settled[0] = cap
    assert_same_bits(run(disturbed, 4), run(plain, 4))


def test_every_outcome_has_a_sentence_and_every_failure_a_remedy() -> None:
    for outcome in Outcome:
        assert outcome.value.endswith(".")
        assert (outcome in REMEDIES) == (outcome not in (*ORDINARY, Outcome.ROUND_OFF))


def test_attempts_add_up() -> None:
    bad = StepRecord(Outcome.CAPPED, 7, 70, completed=False, steps=0, retries=1, start=1.0)
    good = StepRecord(Outcome.CONVERGED, 3, 30, residual=2.0, work=0.5, start=1.0, error=1e-3, unsolved=1e-5)
    last = StepRecord(Outcome.CONVERGED, 2, 20, residual=1.0, work=0.25, start=1.5, error=2e-3, unsolved=1e-6)
    whole = joined([bad, good, last])
    assert (whole.outcome, whole.newton_iterations, whole.cg_iterations) == (Outcome.CONVERGED, 12, 120)
    assert (whole.steps, whole.retries, whole.work, whole.residual, whole.start) == (2, 1, 0.75, 2.0, 1.0)
    record = RunRecord()
    for attempt in (bad, good, last):
        record.add_step(attempt)
    assert record.outcomes == {"capped": 1, "converged": 2}
    assert (record.steps, record.retries, record.newton_unconverged) == (2, 1, 1)
    assert record.error_estimate == pytest.approx({"time_step": 3e-3, "linear_solve": 1.1e-5})
    assert record.as_dict()["outcomes"] == record.outcomes


def swinging(steps: int, **settings: Any) -> Simulation:
    """A prestretched strip between two held ends, for 0.4 s in 4 frames of so many steps."""
    shape = sheet((13, 2), (1.0, 1 / 12))
    start = shape.positions * [1.2, 1.0, 1.0]
    start[..., 2] = 0.05 * np.sin(np.pi * shape.positions[..., 0])
    material = Material(areal_density=0.2, membrane_stiffness=15.0, poisson_ratio=0.0)
    body = hanging(shape=shape, material=material, initial_positions=start, pins=(Pin("edge:u,0"), Pin("edge:u,1")))
    options: dict[str, Any] = {"gravity": (0.0, 0.0, 0.0), "fps": 10.0, "substeps": steps} | settings
    simulation = Simulation([body], settings=replace(PRECISE, **options))
    for _ in range(4):
        simulation.advance_frame()
    return simulation


@pytest.fixture(scope="module")
def exact() -> Array:
    return swinging(400, integrator="verlet")["sheet"].positions()


@pytest.mark.parametrize("integrator", [*SEARCHING, "energy-momentum"])
def test_adaptive_steps_follow_their_tolerance(integrator: str, exact: Array) -> None:
    errors, steps = [], []
    for tolerance in (1e-4, 1e-5):
        simulation = swinging(1, integrator=integrator, time_step="adaptive", time_tolerance=tolerance)
        record = simulation.record()
        assert simulation.time == pytest.approx(0.4, abs=1e-15)
        errors.append(float(np.abs(simulation["sheet"].positions() - exact).max()))
        steps.append(record.steps)
        assert record.outcomes.get("inaccurate", 0) == record.retries < 0.5 * record.steps
        # Errors of the steps add up to something of the size of the error.
        assert 0.1 * errors[-1] < record.error_estimate["time_step"] < 10 * errors[-1]
    order = 1 if integrator == "implicit-euler" else 2
    assert errors[1] < errors[0] * 10 ** (-0.7 * order / (order + 1))
    assert steps[0] > 4
    assert 10 ** (0.7 / (order + 1)) < steps[1] / steps[0] < 10 ** (1.4 / (order + 1))


def test_adaptive_steps_are_short_only_where_they_have_to_be() -> None:
    # A plucked strip that drag brings to rest.
    shape = sheet((13, 2), (1.0, 1 / 12))
    start = shape.positions + np.array([0.0, 0.0, 0.1]) * np.sin(np.pi * shape.positions[..., :1])
    body = hanging(shape=shape, initial_positions=start, pins=(Pin("edge:u,0"), Pin("edge:u,1")), drag=20.0)
    settings = replace(PRECISE, time_step="adaptive", time_tolerance=1e-5, fps=10.0)
    simulation = Simulation([body], settings=settings)
    steps = [simulation.step().steps for _ in range(20)]
    assert steps[0] > 5
    assert steps[-1] == 1


def test_errors_are_estimated_with_fixed_steps_too() -> None:
    estimates = [swinging(n, integrator="sdirk2").record().error_estimate["time_step"] for n in (4, 8, 16)]
    assert estimates[0] > 3.0 * estimates[1] > 9.0 * estimates[2] > 0.0
    assert swinging(4, integrator="bdf2", cg_tolerance=1e-1).record().error_estimate["linear_solve"] > 1e-10


def test_time_tolerance_must_be_positive() -> None:
    with pytest.raises(InputError, match=r"time_tolerance = -1\.0: must be positive \[m\]"):
        Settings(time_tolerance=-1.0)


def test_methods_say_what_they_do_otherwise() -> None:
    def notes(**settings: Any) -> str:
        body = hanging((4, 5), material=replace(CLOTH, bending_stiffness=None))
        return " ".join(Simulation([body], settings=replace(REAL_TIME, **settings)).notes)

    assert notes() == ""
    assert notes(integrator="tr-bdf2", newton_iterations=3) == ""
    assert "energy-momentum has to converge, to newton_tolerance" in notes(integrator="energy-momentum")
    assert notes(integrator="energy-momentum", newton_iterations=0) == ""
    assert "makes 1 Newton iteration a step" in notes(integrator="linear-implicit", newton_iterations=0)
    assert "verlet takes" in notes(integrator="verlet")
    assert notes(integrator="verlet", substeps=100) == ""


@pytest.mark.parametrize("integrator", ["bdf2", "tr-bdf2"])
def test_a_change_from_outside_is_no_history(integrator: str) -> None:
    # Moved, turned loose at new velocities: from there it goes on as a simulation that starts so.
    simulation = Simulation([hanging((7, 7))], settings=replace(PRECISE, integrator=integrator))
    run(simulation, 5)
    start = sheet((7, 7)).positions * [0.9, 1.1, 1.0] + [0.0, 0.0, 0.3]
    handle = simulation["sheet"]
    handle.state.x.assign(handle.model.layout.pack(start))
    handle.state.v.zero_()
    handle.model.target.assign(handle.model.layout.pack(start * (1.0 - handle.model.download(handle.state.free))))
    simulation.restart()
    fresh = Simulation([hanging((7, 7))], settings=replace(PRECISE, integrator=integrator))
    other = fresh["sheet"]
    other.state.x.assign(handle.state.x)
    other.model.target.assign(handle.model.target)
    assert_same_bits(run(simulation, 3), run(fresh, 3))
