"""The layout of the house: imports only go down, only `warpdeform` is installed, and importing it costs nothing."""

import ast
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest

import warpdeform

ROOT = Path(__file__).parents[1]

FLOORS = (
    {"kernels"},
    {
        "grid",
        "halo",
        "material",
        "presets",
        "measure",
        "model",
        "shape",
        "obstacle",
        "track",
        "wind",
        "body",
        "contact",
        "near",
        "skins",
        "relaxing",
        "state",
        "device",
        "attachment",
        "clamps",
        "launching",
        "team",
        "errors",
        "result",
        "settings",
        "simplices",
        "crossings",
        "topology",
        "selectors",
        "tensors",
        "section",
        "frenet",
        "array_file",
        "coefficients",
        "varying",
        "growth",
    },
    {"forces", "linear"},
    {"integrators"},
    {"scene", "usd", "simulation", "touching", "handle", "information"},
    {"cli", "viewer", "study", "bench", "__main__"},
)
"""Modules by floor (design 3.2): a module imports its own floor and those below."""

DESCRIPTIONS = (
    "errors",
    "varying",
    "growth",
    "presets",
    "material",
    "shape",
    "track",
    "obstacle",
    "wind",
    "body",
    "contact",
    "settings",
    "result",
    "section",
    "coefficients",
)
"""What a scene is described with: pure NumPy, so that a command line answers before Warp is loaded."""

FLOOR_OF = {name: floor for floor, names in enumerate(FLOORS) for name in names}
HOME_OF = {name: home.split(".")[0] for home, names in warpdeform._HOMES.items() for name in names}

GUESTS = {"pxr", "viser", "matplotlib", "mpl_toolkits", "bpy", "mujoco", "newton", "taichi"}
"""Heavy guests, received on floors 4 and 5 only."""


def sources() -> Iterator[tuple[str, Path]]:
    """Every module of the package with the room it lives in, the doorstep `__init__` aside."""
    for package, room in ((ROOT / "warpdeform", None), (ROOT / "kernels", "kernels")):
        for folder, _, files in os.walk(package):
            for file in sorted(files):
                path = Path(folder, file)
                inside = path.relative_to(package).with_suffix("").parts
                if path.suffix == ".py" and (room or inside != ("__init__",)):
                    yield room or inside[0], path


SOURCES = [pytest.param(room, path, id=str(path.relative_to(ROOT))) for room, path in sources()]


def imported(path: Path) -> Iterator[str]:
    """Dotted names of everything that a module imports, at its top or inside a function."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} is a relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def rooms_imported(path: Path) -> Iterator[str]:
    """Rooms of the house that a module imports; a public name counts as the room it lives in."""
    for name in imported(path):
        package, _, rest = name.partition(".")
        if package == "warpdeform" and rest != "__version__":
            room = rest.split(".")[0]
            yield HOME_OF.get(room, room)


@pytest.mark.parametrize(("room", "path"), SOURCES)
def test_imports_only_go_down(room: str, path: Path) -> None:
    assert room in FLOOR_OF, f"{room} stands on no floor: add it to FLOORS"
    for other in rooms_imported(path):
        assert other in FLOOR_OF, f"{path} imports warpdeform.{other}, which stands on no floor"
        assert FLOOR_OF[other] <= FLOOR_OF[room], f"{room} (floor {FLOOR_OF[room]}) imports {other} from above"


@pytest.mark.parametrize(("room", "path"), SOURCES)
def test_guests_stay_upstairs(room: str, path: Path) -> None:
    packages = {name.split(".")[0] for name in imported(path)}
    assert "kernels" not in packages
    if FLOOR_OF[room] < 4:
        assert not packages & GUESTS
    if room == "kernels":
        assert packages <= {"warp", "warpdeform", *sys.stdlib_module_names}


def loaded(statement: str) -> set[str]:
    """Top-level packages in a fresh interpreter after `statement`."""
    code = f"import sys; {statement}; print(*{{name.split('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_importing_the_package_loads_nothing_heavy() -> None:
    assert not loaded("import warpdeform") & {"warp", "pxr", "numpy", "pydantic"}


def test_descriptions_are_pure_numpy() -> None:
    packages = loaded("import " + ", ".join(f"warpdeform.{name}" for name in DESCRIPTIONS))
    assert "numpy" in packages
    assert not packages & {"warp", *GUESTS}


@pytest.mark.parametrize("name", warpdeform.__all__)
def test_public_names_are_found(name: str) -> None:
    assert getattr(warpdeform, name) is not None
    assert name in dir(warpdeform)


def test_every_public_name_is_exported_once() -> None:
    assert sorted(warpdeform.__all__) == sorted([*HOME_OF, "__version__"])
    with pytest.raises(AttributeError, match="no attribute 'Blanket'"):
        _ = warpdeform.Blanket


@pytest.mark.parametrize("statement", ["import kernels", "from kernels import lanes", "import kernels.lanes as lanes"])
def test_lint_bans_a_second_name_for_the_kernels(statement: str) -> None:
    if find_spec("ruff") is None:
        pytest.skip("ruff is not installed: it is in the extra [test]")
    command = [
        sys.executable,
        "-m",
        "ruff",
        "check",
        "--select",
        "TID251",
        "--stdin-filename",
        "warpdeform/body.py",
        "-",
    ]
    run = subprocess.run(command, cwd=ROOT, input=f"{statement}\n", capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert "TID251" in run.stdout


def test_nothing_names_a_path_of_one_machine() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:
        pytest.skip("not a git checkout")
    machine = re.compile(rb"(?<![\w.])/(?:home/|work/|Users/|root/\.)\w|[A-Z]:\\Users")
    for name in listed.stdout.splitlines():
        path = ROOT / name
        if path.is_file() and b"\0" not in (content := path.read_bytes()):
            assert not machine.search(content), f"{name} names a path of one machine"


@pytest.mark.parametrize("through", ["checkout", "sdist"])
def test_wheel_holds_one_package_with_kernels_and_scenes(tmp_path: Path, through: str) -> None:
    if find_spec("build") is None:
        pytest.skip("build is not installed: it is in the extra [test]")
    if find_spec("setuptools") is None or int(version("setuptools").split(".")[0]) < 77:
        pytest.skip("setuptools 77 is not installed: it is in the extra [test]")
    copy = tmp_path / "checkout"
    copytree(ROOT, copy, symlinks=True, ignore=ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist"))
    how = ["--wheel"] if through == "checkout" else []
    command = [sys.executable, "-m", "build", "--no-isolation", *how, "--outdir", str(tmp_path / "dist"), str(copy)]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr

    kernels = {f"warpdeform/kernels/{path.name}" for path in (ROOT / "kernels").glob("*.py")}
    scenes = {f"warpdeform/scenes/{path.name}" for path in (ROOT / "scenes").glob("*.toml")}
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    information = f"warpdeform-{warpdeform.__version__}.dist-info"
    assert kernels
    assert scenes
    assert {name.split("/")[0] for name in names} == {"warpdeform", information}
    assert kernels | scenes <= names
    assert {"warpdeform/py.typed", f"{information}/licenses/LICENSE", f"{information}/entry_points.txt"} <= names
    modules = {path.relative_to(ROOT).as_posix() for room, path in sources() if room != "kernels"}
    assert modules <= names

    if through == "sdist":
        (archive,) = (tmp_path / "dist").glob("*.tar.gz")
        with tarfile.open(archive) as tar:
            files = {member.name.partition("/")[2] for member in tar.getmembers() if member.isfile()}
        assert kernels | scenes | {"LICENSE", "README.md", "pyproject.toml"} <= files
