"""`python -m warpdeform.study.bench.first_frame SCENE FILE.usdc [VALUES]`: a fresh process up to its first frame.

Prints Warp's own lines about modules, and one line of JSON with the seconds of each phase at the end. The imports stand
inside the function because they are what is measured.
"""

import json
import sys
import time
from collections.abc import Iterator
from itertools import pairwise


def main(scene: str, output: str, values: str = "{}") -> None:
    """Write the initial state and the first computed frame of a scene, and print what each phase took.

    Args:
        scene: Name or path of the scene.
        output: The USD file.
        values: Values that replace some of the scene's, as JSON.
    """
    ends: list[tuple[str, float, float]] = [("", time.perf_counter(), time.process_time())]

    def end(phase: str) -> None:
        ends.append((phase, time.perf_counter(), time.process_time()))

    import warp as wp

    end("import Warp")
    wp.init()
    end("initialise Warp")
    from warpdeform.scene import load_scene
    from warpdeform.scene.play import play

    end("import warpdeform and pydantic")
    built = load_scene(scene, {**json.loads(values), "solver.device": "cpu"}, frames=2)
    end("read the scene")
    phases: Iterator[str] = iter(("load kernels, record the step, open USD", "first frame"))
    play(built, output, on_frame=lambda simulation: end(next(phases)))
    end("close the file")
    seconds = {
        phase: {"wall_s": wall - before_wall, "cpu_s": cpu - before_cpu}
        for (_, before_wall, before_cpu), (phase, wall, cpu) in pairwise(ends)
    }
    sys.stdout.write(json.dumps(seconds) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
