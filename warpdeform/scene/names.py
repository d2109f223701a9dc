"""Names in the [solver] table that stand for code or hardware: integrators, preconditioners, devices."""

from __future__ import annotations

from collections.abc import Iterable

from warpdeform.scene.collect import Collector
from warpdeform.scene.keys import closest
from warpdeform.scene.schema import SolverTable


def check_solver_names(table: SolverTable, collector: Collector) -> None:
    """Refuse integrators, preconditioners and devices that do not exist.

    Args:
        table: The [solver] table.
        collector: Takes the mistakes.
    """
    from warpdeform.integrators import INTEGRATORS  # needs Warp, which reading a file does not
    from warpdeform.linear import PRECONDITIONERS

    def check(key: str, known: Iterable[str], problem: str) -> None:
        name, names = getattr(table, key), list(known)
        if name not in names:
            remedy = " ".join((closest(name, names), f"Use {' or '.join(names)}.")).strip()
            collector.refuse(("solver", key), name, problem, remedy)

    check("integrator", INTEGRATORS, "is no integrator")
    check("preconditioner", ("auto", *PRECONDITIONERS), "is no preconditioner")
    check("device", device_names(table.device), "is no device of this machine")


def device_names(wanted: str = "") -> list[str]:
    """The devices of this machine: "auto", "cpu", and "cuda:0" and so on where there are any.

    Args:
        wanted: A name that is being looked for; Warp is not started for those that always exist.
    """
    always = ["auto", "cpu"]
    if wanted in always:
        return always
    import warp as wp

    cuda = [device.alias for device in wp.get_cuda_devices()]
    return [*always, *(["cuda"] if cuda else []), *cuda]
