"""The command line: exit codes, clean messages, pure JSON, quick help, interruption."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pxr import Usd
from typer.testing import CliRunner, Result

from warpdeform.cli import app
from warpdeform.errors import SimulationFailure
from warpdeform.integrators import INTEGRATORS
from warpdeform.scene import scene_names
from warpdeform.simulation import Simulation

KEYS = {
    "frames", "nodes", "sim_s", "wall_s", "setup_s", "newton_iterations", "cg_iterations", "newton_unconverged",
    "retries", "steps", "outcomes", "error_estimate", "max_residual", "max_stretch", "energy", "device", "precision",
    "integrator", "output",
}  # fmt: skip
COARSE = ("--device", "cpu", "--set", "body.0.nodes=[7,6]")


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def start(*arguments: object) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "warpdeform.cli", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("arguments", [("--help",), ("run", "--help"), ("--version",)])
def test_help_loads_nothing_heavy(arguments: tuple[str, ...]) -> None:
    program = (
        "import sys; from warpdeform.cli import app\n"
        "try: app(sys.argv[1:])\n"
        "finally: print([m for m in ('warp', 'pxr', 'numpy', 'matplotlib', 'rich') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_help_names_every_flag() -> None:
    text = call("run", "--help").output
    for flag in ("--out", "--device", "--frames", "--fps", "--integrator", "--precision", "--set", "--json", "--quiet"):
        assert flag in text
    assert "--headless" in text


def test_run_writes_a_file_and_says_what_it_did(tmp_path: Path) -> None:
    done = call("run", "hanging", *COARSE, "--frames", 4, "--out", tmp_path / "out.usdc")
    assert done.exit_code == 0, done.output
    assert f"wrote {tmp_path / 'out.usdc'}" in done.stdout
    for words in ("4 frames", "x real time", "Newton", "CG", "residual"):
        assert words in done.stdout
    assert Usd.Stage.Open(str(tmp_path / "out.usdc")).GetEndTimeCode() == 4


def test_json_is_one_object_alone_on_stdout(tmp_path: Path) -> None:
    process = start("run", "hanging", *COARSE, "--frames", 3, "--out", tmp_path / "out.usda", "--json", "--headless")
    stdout, _ = process.communicate()
    assert process.returncode == 0
    record = json.loads(stdout)
    assert set(record) >= KEYS
    assert set(record["energy"]) == {"kinetic", "elastic", "gravity", "field", "work_in"}
    assert (record["frames"], record["nodes"], record["device"]) == (3, 42, "cpu")
    assert record["output"] == str(tmp_path / "out.usda")


def test_quiet_says_nothing(tmp_path: Path) -> None:
    done = call("run", "hanging", *COARSE, "--frames", 2, "--out", tmp_path / "out.usdc", "--quiet")
    assert (done.exit_code, done.stdout) == (0, "")


def test_flags_and_overrides_reach_the_run(tmp_path: Path) -> None:
    flags = ("--fps", 30, "--integrator", "implicit-euler", "--precision", "float64", "--set", "solver.substeps=2")
    done = call("run", "hanging", *COARSE, *flags, "--frames", 3, "--out", tmp_path / "out.usdc", "--json")
    record = json.loads(done.stdout)
    assert (record["integrator"], record["precision"]) == ("implicit-euler", "float64")
    assert record["sim_s"] == pytest.approx(2 / 30)
    assert record["newton_iterations"] >= 4


def test_help_names_every_integrator() -> None:
    text = " ".join(call("run", "--help").output.split())
    for name in INTEGRATORS:
        assert re.search(rf"[ ,]{name}[,.]", text), name


OVERLAPPING = """
[scene]
name = "overlapping"
[[body]]
name = "table"
nodes = [5, 5]
shape = { kind = "sheet", size = [0.3, 0.3] }
material = "cotton"
pins = [{ nodes = "all" }]
contact_thickness = 0.004
[[body]]
name = "cloth"
nodes = [5, 5]
shape = { kind = "sheet", size = [0.3, 0.3] }
position = [0.01, 0.02, 0.002]
material = "cotton"
contact_thickness = 0.004
[[contact]]
bodies = ["table", "cloth"]
"""


def test_starts_that_overlap_are_relaxed_on_request(tmp_path: Path) -> None:
    scene = tmp_path / "overlapping.toml"
    scene.write_text(OVERLAPPING)
    arguments = ("run", scene, "--device", "cpu", "--frames", 3, "--out", tmp_path / "out.usdc")
    refused = call(*arguments)
    assert refused.exit_code != 0
    assert "overlap at the start" in refused.stderr
    scene.write_text(OVERLAPPING + "relax = true\n")
    done = call(*arguments)
    assert done.exit_code == 0
    assert "the start is relaxed: 25 nodes of cloth moved, by 0.004 m at most" in " ".join(done.stderr.split())
    record = json.loads(call(*arguments, "--json").stdout)
    assert record["contact"]["relaxed"] == pytest.approx(0.004, rel=0.06)
    assert record["contact"]["crossings"] == [0, 0]


def test_a_method_says_what_it_does_otherwise_unless_it_is_to_be_quiet(tmp_path: Path) -> None:
    arguments = ("run", "hanging", *COARSE, "--integrator", "verlet", "--frames", 3, "--out", tmp_path / "out.usdc")
    done = call(*arguments)
    assert (done.exit_code, "verlet takes" in done.stderr) == (0, True)
    assert "verlet" not in call(*arguments, "--quiet").stderr
    record = json.loads(call(*arguments, "--json").stdout)
    assert record["steps"] == record["outcomes"]["explicit"] > 4


def test_what_a_method_cannot_run_is_refused_with_the_reason(tmp_path: Path) -> None:
    done = call("run", "hanging", *COARSE, "--integrator", "energy-momentum", "--out", tmp_path / "out.usdc")
    assert done.exit_code == 2
    words = 'hanging.toml: solver.integrator = "energy-momentum": conserves energy only of membranes and solids'
    assert words in done.stderr
    assert not (tmp_path / "out.usdc").exists()


def test_a_run_that_blows_up_is_caught_counted_and_keeps_its_frames(tmp_path: Path) -> None:
    arguments = ("--set", "body.0.nodes=[17,17]", "--device", "cpu", "--integrator", "terzopoulos", "--frames", 40)
    done = call("run", "hanging", *arguments, "--out", tmp_path / "out.usdc")
    assert done.exit_code == 1
    assert "could not be completed" in done.stderr
    assert "steps were repeated with smaller ones" in done.stdout
    frames = int(done.stdout.split(" frames")[0].split()[-1])
    assert 1 < frames < 40
    assert Usd.Stage.Open(str(tmp_path / "out.usdc")).GetEndTimeCode() == frames


def test_without_out_the_file_is_named_by_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert call("run", "hanging", *COARSE, "--frames", 1).exit_code == 0
    assert (tmp_path / "hanging.usdc").is_file()
    assert call("run", "hanging", *COARSE, "--frames", 1, "--set", "output.file=mine.usda").exit_code == 0
    assert (tmp_path / "mine.usda").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run",), "Missing argument 'SCENE'"),
        (("run", "hanging", "--frames", "0"), "--frames"),
        (("run", "hanging", "--frames", "x"), "--frames"),
        (("run", "hanging", "--nonsense"), "No such option"),
        (("nonsense",), "No such command"),
        (("run", "hangin"), 'scene = "hangin": is neither a packaged scene nor a file. Did you mean "hanging"?'),
        (("run", "hanging", "--out", "x.mp4"), '--out = "x.mp4": has the suffix .mp4'),
        (
            ("run", "hanging", "--device", "cuda:77"),
            '--device: solver.device = "cuda:77": is no device of this machine',
        ),
        (("run", "hanging", "--fps", "0"), "--fps: scene.fps = 0.0: must be a positive number"),
        (("run", "hanging", "--integrator", "rk4"), '--integrator: solver.integrator = "rk4": is no integrator'),
        (("run", "hanging", "--precision", "half"), '--precision: solver.precision = "half"'),
        (("run", "hanging", "--set", "body.0.nods=3"), 'body.0 has no key "nods". Did you mean "nodes"?'),
        (("run", "hanging", "--set", "body.0.nodes=[1,5]"), "--set: body.0.nodes = [1, 5]: must be at least 2"),
        (("run", "hanging", "--set", "nodes"), '--set = "nodes": is no assignment'),
        (("info", "hanging", "--set", "scene.fps=-1"), "--set: scene.fps = -1.0"),
        (("check", "hanging", "--set", "scene.fps=-1"), "--set: scene.fps = -1.0"),
        (("check", "none.usdc"), "does not exist"),
    ],
)
def test_wrong_usage_ends_with_2_and_a_clean_line(arguments: tuple[str, ...], words: str) -> None:
    done = call(*arguments)
    assert done.exit_code == 2
    assert done.stdout == ""
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_an_output_that_cannot_be_written_is_refused_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = call("run", "hanging", "--out", tmp_path / "file" / "out.usdc")
    assert done.exit_code == 2
    assert done.stderr.startswith('--out = "')  # a long value is shortened
    assert f"lies below {tmp_path / 'file'}, which is a file" in done.stderr


def test_a_failed_simulation_ends_with_1_and_keeps_its_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(simulation: Simulation) -> None:
        raise SimulationFailure("sheet", 0.0, (1, 2), "it tore", "Use less.")

    monkeypatch.setattr(Simulation, "advance_frame", fail)
    done = call("run", "hanging", *COARSE, "--out", tmp_path / "out.usdc", "--json")
    assert done.exit_code == 1
    assert json.loads(done.stdout)["frames"] == 1
    assert done.stderr.strip().endswith('body "sheet", node [1, 2], t = 0 s: it tore. Use less.')
    assert Usd.Stage.Open(str(tmp_path / "out.usdc"))


@pytest.mark.skipif(os.name == "nt", reason="terminals of POSIX")
def test_progress_is_shown_on_a_terminal_and_not_on_stdout(tmp_path: Path) -> None:
    master, terminal = os.openpty()
    command = [sys.executable, "-m", "warpdeform.cli", "run", "hanging", *COARSE, "--frames", "30"]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out.usdc")],
        stdout=subprocess.PIPE,
        stderr=terminal,
        env=environment,
        check=True,
        text=True,
    )
    os.close(terminal)
    shown = os.read(master, 100_000).decode()
    os.close(master)
    assert "30/30" in shown
    assert "real time" in shown
    assert done.stdout.startswith("wrote ")


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_ends_with_130_and_a_readable_file(tmp_path: Path, number: signal.Signals) -> None:
    out = tmp_path / "out.usdc"
    process = start("run", "hanging", *COARSE, "--set", "scene.duration=5000", "--out", out, "--json")
    limit = time.monotonic() + 120
    while not (tmp_path / "out.partial" / "chunk_00001.usdc").exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < limit
        time.sleep(0.02)
    process.send_signal(number)
    stdout, stderr = process.communicate()
    assert process.returncode == 130, stderr
    frames = json.loads(stdout)["frames"]
    assert 1 < frames < 300001
    assert f"interrupted after {frames} of 300001 frames" in stderr
    assert "Traceback" not in stderr
    assert Usd.Stage.Open(str(out)).GetEndTimeCode() == frames
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.usdc"]


def test_check_of_a_scene() -> None:
    done = call("check", "hanging")
    assert done.exit_code == 0
    assert done.stdout.startswith("hanging: in order: bodies 1, nodes 4096")
    report = json.loads(call("check", "hanging", "--json").stdout)
    assert (report["ok"], report["mistakes"], report["frames"]) == (True, [], 61)


def test_check_reports_all_mistakes_as_json_too(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text("[scene]\nfps = 0\n[[body]]\nnodes = [1, 5]\n")
    done = call("check", path, "--json")
    assert done.exit_code == 2
    report = json.loads(done.stdout)
    assert report["ok"] is False
    assert len(report["mistakes"]) == 4  # fps, nodes, shape, material
    assert call("check", path).stderr.count(str(path)) == 4


def test_check_of_a_usd_file(tmp_path: Path) -> None:
    out = tmp_path / "out.usda"
    call("run", "hanging", *COARSE, "--frames", 3, "--out", out)
    assert call("check", out).stdout == f"{out}: in order\n"
    out.write_text(out.read_text().replace("metersPerUnit = 1", ""))
    done = call("check", out)
    assert done.exit_code == 1
    assert "metersPerUnit" in done.stderr


def test_check_counts_crossings(tmp_path: Path) -> None:
    out = tmp_path / "out.usda"
    call("run", "hanging", *COARSE, "--frames", 3, "--out", out)
    assert call("check", out, "--crossings").stdout.startswith(f"{out}: in order: frames 3, no crossings, ")
    report = json.loads(call("check", out, "--crossings", "--json").stdout)
    assert report["crossings"] == [0, 0]
    assert report["crossings_per_frame"] == [0, 0, 0]
    assert call("check", "hanging", "--crossings").exit_code == 2


def test_info_lists_bodies_terms_kernels_and_bytes() -> None:
    done = call("info", "hanging", *COARSE)
    assert done.exit_code == 0, done.output
    for words in ("sheet", "gravity", "kernels", "B/node"):
        assert words in done.stdout
    report = json.loads(call("info", "hanging", *COARSE, "--json").stdout)
    assert report["bodies"][0]["nodes"] == [7, 6]
    assert report["bytes_total"] > 0


def test_scenes_lists_every_packaged_scene_with_a_line() -> None:
    lines = call("scenes").stdout.splitlines()
    assert [line.split()[0] for line in lines] == scene_names()
    assert all(len(line.split()) > 4 for line in lines)
    assert [scene["name"] for scene in json.loads(call("scenes", "--json").stdout)["scenes"]] == scene_names()


def test_scenes_publishes_the_schema() -> None:
    schema = json.loads(call("scenes", "--schema").stdout)
    tables = {"scene", "solver", "body", "obstacle", "attachment", "contact", "wind", "output"}
    assert tables == set(schema["properties"])
