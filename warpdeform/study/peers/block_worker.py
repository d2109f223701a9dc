"""`python -m warpdeform.study.peers.block_worker JOB`: one engine drops a block, in a process of its own.

JOB is a JSON object; the answer is a line of JSON, the last that is printed.
"""

import json
import math
import sys
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from warpdeform.errors import SimulationFailure
from warpdeform.study.peers.block import Block, least_volume
from warpdeform.study.peers.block_engines import BLOCK_ENGINES
from warpdeform.study.peers.sheet import FPS


@dataclass(frozen=True)
class BlockJob:
    """What a worker is asked for.

    Attributes:
        engine: Name of the engine.
        setting: The setting's values.
        nodes: Nodes along each side.
        seconds: Simulated time [s].
    """

    engine: str
    setting: dict[str, Any]
    nodes: int
    seconds: float


@dataclass(frozen=True)
class BlockAnswer:
    """What a worker measured.

    Attributes:
        cpu_s_per_s: CPU seconds per simulated second of stepping alone.
        lowest_m: Lowest node of any frame [m]; the ground is at 0.
        rest_m: Lowest node at the end [m].
        height_m: Height from the lowest to the highest node at the end [m].
        least_volume: Smallest volume ratio J of any cell corner, in any frame.
        trouble: Why the run ended early; empty if it did not.
    """

    cpu_s_per_s: float
    lowest_m: float = math.nan
    rest_m: float = math.nan
    height_m: float = math.nan
    least_volume: float = math.nan
    trouble: str = ""


def work(job: BlockJob) -> BlockAnswer:
    """Run a job in this process."""
    block = Block(nodes=job.nodes, seconds=job.seconds)
    session = BLOCK_ENGINES[job.engine].prepare(block, job.setting)
    frames, spent = round(job.seconds * FPS), 0.0
    lowest, volume = math.inf, math.inf
    for frame in range(frames):
        began = time.process_time()
        try:
            session.advance_frame()
        except SimulationFailure as failure:
            return BlockAnswer(math.nan, trouble=f"ended at {frame / FPS:.2f} s: {failure.cause}")
        spent += time.process_time() - began
        x = session.positions()
        if not np.isfinite(x).all():
            return BlockAnswer(math.nan, trouble=f"blew up at {frame / FPS:.2f} s")
        lowest, volume = min(lowest, float(x[..., 2].min())), min(volume, least_volume(x, block.spacing))
    low, high = float(x[..., 2].min()), float(x[..., 2].max())
    return BlockAnswer(spent / job.seconds, lowest, low, high - low, volume)


def main(text: str) -> None:
    """Run the job and print the answer."""
    sys.stdout.write("\n" + json.dumps(asdict(work(BlockJob(**json.loads(text))))) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
