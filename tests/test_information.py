"""What `warpdeform info` tells of a simulation: terms, kernels and bytes, and only what the scene requires."""

import subprocess
import sys

from bodies import REAL_TIME, busy, hanging

from warpdeform.simulation import Simulation


def test_memory_and_terms_are_told() -> None:
    simulation = busy()
    info = simulation.info()
    banner, scarf = info.bodies
    assert [term.name for term in banner.terms] == ["elasticity", "gravity", "drag", "wind", "obstacles"]
    assert [term.name for term in scarf.terms] == ["elasticity", "gravity", "springs", "wind", "obstacles"]
    assert all(term.kernels for body in info.bodies for term in body.terms)
    parts = [body.bytes + sum(term.bytes for term in body.terms) for body in info.bodies]
    assert info.bytes_total == sum(parts) + info.solver_bytes
    lines = info.lines()
    assert lines[0].startswith("sheet: surface 6 x 19")
    assert any("scarf: surface 4 x 7" in line for line in lines)
    assert "block-jacobi" in lines[-2]
    assert lines[-1].startswith(f"total: {info.bytes_total} bytes")
    cloth = Simulation([hanging((64, 64))], settings=REAL_TIME).info()
    assert cloth.bytes_total < 1000 * 64 * 64


def test_membrane_compiles_and_launches_no_curvature() -> None:
    code = """
import warpdeform.kernels.lanes as lanes
made, make = [], lanes.kernel_module
lanes.kernel_module = lambda name, width, real: (made.append(name), make(name, width, real))[1]
from warpdeform.body import Body, Pin
from warpdeform.material import Material
from warpdeform.settings import Settings
from warpdeform.shape import sheet
from warpdeform.simulation import Simulation
material = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3)
body = Body("sheet", sheet((5, 6)), material, pins=(Pin("corner:0,0"),))
simulation = Simulation([body], settings=Settings(device="cpu"))
simulation.advance_frame()
print("TERMS", *[term.name + ":" + ",".join(term.kernels) for term in simulation.info().bodies[0].terms])
print("MODULES", *sorted(set(made)))
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    lines = {
        line.split()[0]: line.split()[1:] for line in result.stdout.splitlines() if line.startswith(("TERMS", "MOD"))
    }
    assert [term.split(":")[0] for term in lines["TERMS"]] == ["elasticity", "gravity"]
    assert "nodes" not in lines["TERMS"][0]
    assert not any("bending" in name for name in lines["MODULES"])
    unused = {"drag", "springs", "wind", "gusts", "fields", "fields_mesh", "guard", "guard_mesh"}
    assert not unused & set(lines["MODULES"])
    assert {"surface_orthogonal", "gravity", "krylov", "stage", "reductions", "decisions"} <= set(lines["MODULES"])
