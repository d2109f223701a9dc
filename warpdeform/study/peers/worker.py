"""`python -m warpdeform.study.peers.worker JOB`: one engine, one setting, in a process of its own.

JOB is a JSON object; the answer is a line of JSON, the last that is printed, and the positions at the checked frames in
the file that the job names. Engines print what they like before it.
"""

import json
import math
import statistics
import sys
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from warpdeform.errors import SimulationFailure
from warpdeform.study.peers.engine import Engine, Setting
from warpdeform.study.peers.engines import ENGINES
from warpdeform.study.peers.sheet import CHECKED, FPS, Array, Sheet, longest_stretch

TORN = 10.0
"""Stretch at which a run counts as blown up."""


@dataclass(frozen=True)
class Job:
    """What a worker is asked for.

    Attributes:
        engine: Name of the engine.
        nodes: Nodes along each side.
        setting: The setting's values.
        frames: Frames to simulate.
        repeats: Runs at most.
        enough_s: CPU seconds of runs after which no further one is begun [s].
        limit_s: CPU seconds at which a run that will take longer is given up [s].
        file: Where positions are written, ending in .npy; empty for nowhere.
    """

    engine: str
    nodes: int
    setting: dict[str, Any]
    frames: int
    repeats: int = 1
    enough_s: float = 0.0
    limit_s: float = math.inf
    file: str = ""


@dataclass(frozen=True)
class Answer:
    """What a worker measured.

    Attributes:
        cpu_s_per_s: CPU seconds per simulated second of stepping alone, each run.
        frames: Frames simulated; fewer than asked for if the run was given up or blew up.
        max_stretch: Longest edge along the grid over its rest length, in any frame.
        lowest: Lowest point of any frame [m].
        trouble: Why the run ended early; empty if it did not.
    """

    cpu_s_per_s: list[float]
    frames: int
    max_stretch: float
    lowest: float
    trouble: str = ""

    @property
    def median(self) -> float:
        """Median CPU seconds per simulated second."""
        return statistics.median(self.cpu_s_per_s)


def work(job: Job) -> Answer:
    """Run a job in this process."""
    engine, sheet = ENGINES[job.engine], Sheet(job.nodes)
    setting = Setting("", job.setting)
    answer, kept = _run(engine, sheet, setting, job)
    spent = list(answer.cpu_s_per_s)
    while not answer.trouble and len(spent) < job.repeats and sum(spent) * job.frames / FPS < job.enough_s:
        spent += _run(engine, sheet, setting, job)[0].cpu_s_per_s
    if job.file:
        np.save(job.file, np.array(kept))
    return Answer(spent, answer.frames, answer.max_stretch, answer.lowest, answer.trouble)


def _run(engine: Engine, sheet: Sheet, setting: Setting, job: Job) -> tuple[Answer, list[Array]]:
    session = engine.prepare(sheet, setting)
    spent, frames, stretch, lowest, trouble = 0.0, 0, 1.0, 0.0, ""
    kept: list[Array] = []
    while frames < job.frames and not trouble:
        began = time.process_time()
        try:
            session.advance_frame()
        except SimulationFailure as failure:
            trouble = f"blew up at {frames / FPS:.2f} s: {failure.cause}"
        spent += time.process_time() - began
        frames += 1
        x = session.positions()
        found = longest_stretch(x, sheet.spacing)
        stretch, lowest = max(stretch, found), min(lowest, float(x[..., 2].min()))
        if frames in CHECKED:
            kept.append(x)
        if not trouble and not found < TORN:
            trouble = f"blew up at {frames / FPS:.2f} s"
        elif spent / frames * job.frames > job.limit_s and frames < job.frames:
            trouble = f"over the limit of {job.limit_s:g} CPU s"
    return Answer([spent * FPS / frames], frames, stretch, lowest, trouble), kept


def main(text: str) -> None:
    """Run the job and print the answer."""
    sys.stdout.write("\n" + json.dumps(asdict(work(Job(**json.loads(text))))) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
