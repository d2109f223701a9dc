"""Curves and solids that weigh something and do not resist: for what all kinds of bodies have in common."""

import functools
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp

from warpdeform import body, handle
from warpdeform.forces.force import Force
from warpdeform.kernels.lanes import lanes
from warpdeform.kernels.products import Gathering
from warpdeform.launching import RowStruct
from warpdeform.material import Material
from warpdeform.model import Model

MATERIAL = Material(areal_density=1.0, eta=1.0)
SECTION: Any = SimpleNamespace(radius=0.005)


class Limp(Force):
    """Elasticity without any resistance."""

    name = "elasticity"
    elastic = True
    energy_kind = "elastic"
    sample_nodes = 2

    def __init__(self, model: Model) -> None:
        self.gathering = nothing(model.lane_width, model.real)
        self.fluxes = RowStruct(self.gathering.Fluxes, {"unused": model.zeros(1)})


@functools.cache
def nothing(width: int, real: Any) -> Gathering:
    """Gathers no force."""
    words = lanes(width, real)
    vector, splat, zero = words.vector, words.splat, real(0.0)

    @wp.struct
    class Fluxes:
        unused: wp.array3d(dtype=real)  # type: ignore[valid-type]

    @wp.func
    def gathered(fluxes: Fluxes, i: int, j: int):  # type: ignore[no-untyped-def]
        return vector(splat(zero), splat(zero), splat(zero))

    return Gathering("nothing", gathered, Fluxes)


@pytest.fixture
def limp_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Curves of 0.1 kg/m and solids of 500 kg/m3 without elasticity."""
    for kind, density in (("curve", 0.1), ("solid", 500.0)):
        monkeypatch.setitem(body.DENSITIES, kind, lambda _, density=density: density)
        monkeypatch.setitem(handle.ELASTICITY, kind, Limp)
