"""Curves and solids that weigh something and do not resist: for what all kinds of bodies have in common."""

from types import SimpleNamespace
from typing import Any

import pytest

from warpdeform import body, handle
from warpdeform.forces.force import Force
from warpdeform.material import Material

MATERIAL = Material(areal_density=1.0, eta=1.0)
SECTION: Any = SimpleNamespace(radius=0.005)


class Limp(Force):
    """Elasticity without any resistance."""

    name = "elasticity"
    elastic = True
    energy_kind = "elastic"
    sample_nodes = 2


@pytest.fixture
def limp_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Curves of 0.1 kg/m and solids of 500 kg/m3 without elasticity."""
    for kind, density in (("curve", 0.1), ("solid", 500.0)):
        monkeypatch.setitem(body.DENSITIES, kind, lambda _, density=density: density)
        monkeypatch.setitem(handle.ELASTICITY, kind, lambda _: Limp())
        monkeypatch.delitem(handle.WIND, kind, raising=False)
