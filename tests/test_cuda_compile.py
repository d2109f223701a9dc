"""Every kernel compiles for CUDA, ahead of time: no GPU is needed, so that the GPU path cannot rot unseen.

The kernels are found by themselves: every cached factory of every file in kernels/, for all its options, at CUDA's lane
width. A few modules compile at a time, each test waits for its own.
"""

import inspect
import itertools
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import warp as wp

import warpdeform.kernels
from warpdeform.kernels.curve import curve
from warpdeform.kernels.explicit import Kick
from warpdeform.kernels.products import Gathering
from warpdeform.kernels.solid_gather import solid_gather
from warpdeform.kernels.surface import surface

Compile = Callable[[list[wp.Kernel], int], bytes]

VALUES: dict[Any, list[Any]] = {
    "width": [1], "real": [wp.float32, wp.float64], "strains": [0, 2, 3], "kind": ["curve", "surface", "solid"],
    bool: [False, True],
}  # fmt: skip
"""What is passed for the parameters of a factory, by name or by annotation."""
GATHERINGS: list[Callable[[int, Any], Gathering]] = [
    partial(lambda width, real, flags: surface(width, real, *flags).gathering, flags=flags)
    for flags in itertools.product((False, True), repeat=2)
]
GATHERINGS += [partial(lambda width, real, n: curve(width, real, n).gathering, n=n) for n in (0, 2, 3)]
GATHERINGS.append(lambda width, real: solid_gather(width, real).gathering)
"""The gatherings of all elastic terms, by lane width and precision."""
KICKS: list[Callable[[int, Any], Kick]] = [
    lambda width, real: Kick(surface(width, real, True, True).gathering, True, True, True, False, True),
    lambda width, real: Kick(None, True, False, True, True, True),
]
"""Two explicit steps, which together have all there is to a kick, by lane width and precision."""
WORDS_ONLY = {
    "angle_system", "angles", "curve_geometry", "distances", "geometry", "lanes", "no_gathering", "solid_geometry",
    "solid_volume", "strand_border", "strand_words", "transfer_tables", "transfers",
    "potentials", "box_words", "box_distances", "closest", "contact_law", "kept_separation",
}  # fmt: skip
"""Factories of device functions that have no kernel of their own."""

PROBE = wp.get_module("warpdeform_probe")


@wp.kernel(module=PROBE)
def probe(a: wp.array(dtype=float)):
    a[wp.tid()] = 1.0


def kernels_of(factory: Callable[..., Any], values: tuple[Any, ...]) -> list[wp.Kernel]:
    return [kernel for kernel in vars(factory(*values)).values() if isinstance(kernel, wp.Kernel)]


def factories() -> Iterator[Callable[..., Any]]:
    for path in sorted(Path(warpdeform.kernels.__file__).parent.glob("*.py")):
        module = import_module(f"warpdeform.kernels.{path.stem}")
        for name, factory in vars(module).items():
            if hasattr(factory, "cache_info") and factory.__module__ == module.__name__ and name[0] != "_":
                yield factory


def variants() -> Iterator[Any]:
    """Every factory but those of words, with every combination of its options."""
    for factory in factories():
        parameters = inspect.signature(factory).parameters.values()
        known: dict[Any, list[Any]] = {**VALUES, Gathering: GATHERINGS, Kick: KICKS}
        options = [known[p.name if p.name in known else p.annotation] for p in parameters]
        for chosen in itertools.product(*options) if factory.__name__ not in WORDS_ONLY else ():
            values = tuple(value(*chosen[:2]) if value in (*GATHERINGS, *KICKS) else value for value in chosen)
            words = [getattr(value, "__name__", getattr(value, "name", str(value))) for value in values]
            yield pytest.param(factory, values, id="-".join([factory.__name__, *words]))


VARIANTS = list(variants())


@pytest.fixture(scope="module")
def compile_for(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Compile]:
    """Compiles the module of some kernels for an architecture; all that the selected tests need is begun at once."""
    try:
        wp.compile_aot_module(PROBE, arch=[75], use_ptx=False, module_dir=tmp_path_factory.mktemp("probe"))
    except RuntimeError as error:
        pytest.skip(f"this build of Warp does not compile for CUDA: {error}")

    def cubin(module: Any, arch: int) -> bytes:
        folder = tmp_path_factory.mktemp(f"{module.name}_{arch}")
        (path,) = wp.compile_aot_module(module, arch=[arch], use_ptx=False, module_dir=folder)
        return Path(path).read_bytes()

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        begun: dict[tuple[str, int], Future[bytes]] = {}
        for item in request.session.items:
            given = item.callspec.params if hasattr(item, "callspec") else {}
            if item.path == request.path and "factory" in given:
                module = kernels_of(given["factory"], given["values"])[0].module
                begun[module.name, given["arch"]] = pool.submit(cubin, module, given["arch"])
        yield lambda kernels, arch: begun[kernels[0].module.name, arch].result()
        pool.shutdown(cancel_futures=True)


@pytest.mark.parametrize("arch", [75, pytest.param(90, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("factory", "values"), VARIANTS)
def test_kernels_compile_for_cuda(
    factory: Callable[..., Any], values: tuple[Any, ...], arch: int, compile_for: Compile
) -> None:
    kernels = kernels_of(factory, values)
    assert len({kernel.module for kernel in kernels}) == 1
    cubin = compile_for(kernels, arch)
    assert cubin[:4] == b"\x7fELF"
    for kernel in kernels:
        assert kernel.get_mangled_name().encode() in cubin


def test_no_factory_of_kernels_is_overlooked() -> None:
    found = {factory.__name__ for factory in factories()}
    assert found >= WORDS_ONLY
    assert {"krylov", "reductions", "stage", "decisions", "surface", "surface_coupling", "kicks", "bursts"} <= found
    assert {"fields", "guards", "wind"} <= found
    assert {"curve", "curve_frame", "curve_settle", "curve_blocks", "strand"} <= found
    assert {"solid", "solid_blocks", "solid_gather", "solid_levels"} <= found
    modules = [kernels_of(*variant.values)[0].module.name for variant in VARIANTS]
    assert len(set(modules)) == len(modules)
