"""A model is the one that was meant, and can do nothing but compute; a config can name no code."""

import ast
import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from distloc.geometry.camera import Camera
from service.config.sections import ConfigError, SegmenterConfig
from service.segmenters.model_session import ModelError, ModelSession
from service.segmenters.segment import make_segmenter
from tests.support.onnx_models import CARD, red_model
from tests.support.places import ROOT

CAMERA = Camera(64, 32, 50.0, 50.0, 32.0, 16.0)
_SIZE = 4096  # with fewer ONNX Runtime fails on weights beside a model of bytes for another reason
CPU = ("CPUExecutionProvider",)


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_model_of_the_right_sha256_runs_and_a_changed_one_is_refused(tmp_path: Path) -> None:
    path = red_model(tmp_path / "red.onnx", CARD)
    meant = sha256(path)
    for text in (meant, meant.upper()):
        make_segmenter(SegmenterConfig(kind="onnx", model=str(path), sha256=text, providers=CPU), CAMERA)
    red_model(path, {**CARD, "threshold": "0.9"})
    with pytest.raises(ConfigError, match=r"^segmenter\.sha256 is ") as caught:
        make_segmenter(SegmenterConfig(kind="onnx", model=str(path), sha256=meant, providers=CPU), CAMERA)
    assert meant in str(caught.value) and sha256(path) in str(caught.value) and "\n" not in str(caught.value)


def lacking_sha256(folder: Path) -> list[str]:
    """Models of a folder whose card, NAME.md beside them, does not have their sha256."""
    cards = [(path, path.with_suffix(".md")) for path in folder.glob("*.onnx")]
    return [path.name for path, card in cards if not (card.exists() and sha256(path) in card.read_text())]


def test_each_model_that_ships_has_its_sha256_in_its_card(tmp_path: Path) -> None:
    for name in ("right", "wrong", "bare"):
        (tmp_path / f"{name}.onnx").write_bytes(name.encode())
    (tmp_path / "right.md").write_text(f"sha256: {sha256(tmp_path / 'right.onnx')}\n")
    (tmp_path / "wrong.md").write_text(f"sha256: {sha256(tmp_path / 'right.onnx')}\n")
    assert sorted(lacking_sha256(tmp_path)) == ["bare.onnx", "wrong.onnx"]
    assert lacking_sha256(ROOT / "models") == []


def test_the_runtime_tells_nobody_what_it_runs(tmp_path: Path) -> None:
    path, home = red_model(tmp_path / "red.onnx", CARD), tmp_path / "home"
    home.mkdir()
    script = f"""
import pathlib
import numpy as np
from service.segmenters.model_session import ModelError, ModelSession
session = ModelSession(pathlib.Path({str(path)!r}), {CPU})
port = session.inputs[0]
shape = [side if isinstance(side, int) else 1 for side in port.shape]
session.run(np.zeros(shape, np.float32), session.outputs[0].name)
maps = pathlib.Path("/proc/self/maps").read_text()
assert "onnxruntime" in maps
print(".db" in maps)
"""
    # where a build or a test seems to run, ONNX Runtime is silent by itself
    unset = ("CI", "GITHUB_ACTIONS", "TF_BUILD", "ORT_DISABLE_TELEMETRY", "ORT_RUNNING_UNIT_TESTS")
    env = {name: value for name, value in os.environ.items() if name not in unset}
    env |= {"HOME": str(home), "XDG_CACHE_HOME": str(home / "cache")}
    done = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
    assert list(home.rglob("*")) == []


def adding_model(path: Path, weights_at: str = "", domain: str = "") -> Path:
    """y = x + w, with w in another file or the sum by an operator of another domain."""
    weights = TensorProto(name="w", data_type=TensorProto.FLOAT, dims=[_SIZE])
    if weights_at:
        weights.data_location = TensorProto.EXTERNAL
        entry = weights.external_data.add()
        entry.key, entry.value = "location", weights_at
    else:
        weights.raw_data = np.ones(_SIZE, np.float32).tobytes()
    ports = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [_SIZE]) for name in "xy"]
    node = helper.make_node("Add", ["x", "w"], ["y"], domain=domain)
    graph = helper.make_graph([node], "sum", ports[:1], ports[1:], [weights])
    opsets = [helper.make_opsetid("", 17)] + [helper.make_opsetid(domain, 1)] * bool(domain)
    onnx.save(helper.make_model(graph, opset_imports=opsets, ir_version=8), str(path))
    return path


@pytest.mark.parametrize("where", ["../secret.bin", "ABSOLUTE", "sub/../../secret.bin", "link.bin"])
def test_a_model_reads_no_file_outside_its_folder(tmp_path: Path, where: str) -> None:
    folder = tmp_path / "models"
    (folder / "sub").mkdir(parents=True)
    np.full(_SIZE, 7, np.float32).tofile(tmp_path / "secret.bin")
    np.full(_SIZE, 8, np.float32).tofile(folder / "own.bin")
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    assert (
        ModelSession(adding_model(folder / "good.onnx", "own.bin"), CPU).run(np.zeros(_SIZE, np.float32), "y")[0] == 8
    )
    path = adding_model(folder / "bad.onnx", str(tmp_path / "secret.bin") if where == "ABSOLUTE" else where)
    with pytest.raises(ConfigError, match=r"bad\.onnx.*not a model that can be run"):
        ModelSession(path, CPU)


def test_with_a_sha256_no_weights_are_taken_that_it_does_not_cover(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.full(_SIZE, 8, np.float32).tofile(tmp_path / "own.bin")
    path = adding_model(tmp_path / "m.onnx", "own.bin")
    ModelSession(path, CPU)
    monkeypatch.chdir(tmp_path)  # where a model of bytes looks for its weights
    with pytest.raises(ConfigError, match="not a model that can be run"):
        ModelSession(path, CPU, sha256(path))


def test_operators_from_a_library_are_refused(tmp_path: Path) -> None:
    for domain in ("evil", "./evil.so", "com.microsoft.evil"):
        with pytest.raises(ConfigError, match="not a model that can be run"):
            ModelSession(adding_model(tmp_path / "m.onnx", domain=domain), CPU)


def test_no_provider_is_loaded_from_a_path(tmp_path: Path) -> None:
    path = adding_model(tmp_path / "m.onnx")
    library = tmp_path / "provider.so"
    library.write_bytes(b"\x7fELF")
    assert ModelSession(path, (str(library), "EvilExecutionProvider")).provider == CPU[0]


FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "register_custom_ops_library"}
LOOKS_ONLY = {("importlib.util", "find_spec")}  # whether a package is there
FORBIDDEN_MODULES = {"pickle", "marshal", "shelve", "dill", "joblib", "yaml", "importlib", "runpy", "code", "ctypes"}


def _top(node: ast.ImportFrom) -> str:
    return (node.module or "").split(".")[0]


def what_runs_code(source: str) -> set[str]:
    """Names in a module's source that could turn data into code."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & FORBIDDEN_MODULES
        elif isinstance(node, ast.ImportFrom):
            is_looking = {(node.module, alias.name) for alias in node.names} <= LOOKS_ONLY
            is_own = node.module == "importlib" and imports_from_its_table(source)
            is_harmless = is_looking or is_own or node.module == "importlib.metadata"
            found |= set() if is_harmless else {_top(node)} & FORBIDDEN_MODULES
        elif isinstance(node, ast.Call):
            function = node.func
            is_method = isinstance(function, ast.Attribute)
            name = function.attr if is_method else getattr(function, "id", "")
            is_of_re = is_method and name == "compile"
            found |= set() if is_of_re else {name} & FORBIDDEN_CALLS
            found |= {"allow_pickle" for word in node.keywords if word.arg == "allow_pickle"}
            is_shell = any(word.arg == "shell" for word in node.keywords)
            found |= {"shell"} if is_shell or name in ("system", "popen") else set()
    return found - ({"ctypes"} if loads_no_library(source) else set())


def imports_from_its_table(source: str) -> bool:
    """Whether a module imports others by name from its own table alone, which is how `distloc` is quick to import."""
    nodes = list(ast.walk(ast.parse(source)))
    named = [
        alias.name
        for node in nodes
        if isinstance(node, ast.ImportFrom) and node.module == "importlib"
        for alias in node.names
    ]
    uses = [node for node in nodes if isinstance(node, ast.Name) and node.id == "import_module"]
    calls = {ast.unparse(node) for node in nodes if isinstance(node, ast.Call) and node.func in uses}
    return named == ["import_module"] and len(uses) == 1 and calls == {"import_module(_HOME[name])"}


def loads_no_library(source: str) -> bool:
    """Whether a module's ctypes is there for system calls alone, by the C library that Python itself has loaded."""
    nodes = list(ast.walk(ast.parse(source)))
    attributes = [node for node in nodes if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "ctypes"]
    calls = [node for node in nodes if isinstance(node, ast.Call) and ast.unparse(node.func) == "ctypes.CDLL"]
    is_renamed = any(isinstance(node, ast.alias) and "ctypes" in node.name and node.asname for node in nodes)
    is_from = any(isinstance(node, ast.ImportFrom) and "ctypes" in str(node.module) for node in nodes)
    used = {node.attr for node in attributes}
    return (
        used <= {"CDLL", "c_ulong"}
        and {ast.unparse(call) for call in calls} == {"ctypes.CDLL(None)"}
        and not (is_renamed or is_from)
    )


FLYING = sorted([*(ROOT / "service").rglob("*.py"), *(ROOT / "distloc").rglob("*.py")])


@pytest.mark.parametrize("path", FLYING, ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_turns_data_into_code(path: Path) -> None:
    assert what_runs_code(path.read_text(encoding="utf-8")) == set()


@pytest.mark.parametrize(
    "source",
    ["import pickle", "from yaml import load", "eval(x)", "np.load(f, allow_pickle=True)", "os.system(x)", "exec(x)",
     "subprocess.run(x, shell=True)", "options.register_custom_ops_library(x)", "__import__(x)", "import ctypes",
     "import ctypes; ctypes.CDLL(x)", "import ctypes; ctypes.CDLL(None); ctypes.CDLL(f(x))",
     "import ctypes; ctypes.CDLL(None, handle=x)", "from ctypes import CDLL",
     "import ctypes; ctypes.CDLL(None); ctypes.pythonapi", "import ctypes; ctypes.CDLL(None); ctypes.PyDLL(x)",
     "from importlib.util import module_from_spec", "from importlib import import_module; import_module(x)",
     "from importlib import import_module; import_module(_HOME[name]); y = import_module"],
)  # fmt: skip
def test_the_search_finds_what_it_looks_for(source: str) -> None:
    assert what_runs_code(source)
    assert len(FLYING) > 50 and what_runs_code("re.compile(x)") == set()
    assert what_runs_code("import ctypes; ctypes.CDLL(None).prctl(1, ctypes.c_ulong(9))") == set()


def test_a_model_that_would_run_for_hours_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.segmenters.model_session.RUN_LIMIT_S", 0.2)
    scalar = [helper.make_tensor_value_info(name, kind, []) for name, kind in (("i", 7), ("go", 9))]
    carried = helper.make_tensor_value_info("a", TensorProto.FLOAT, [1])
    given = [helper.make_tensor_value_info("going", 9, []), helper.make_tensor_value_info("b", TensorProto.FLOAT, [1])]
    steps = [helper.make_node("Identity", ["go"], ["going"]), helper.make_node("Add", ["a", "a"], ["b"])]
    body = helper.make_graph(steps, "body", [*scalar, carried], given)
    graph = helper.make_graph(
        [helper.make_node("Loop", ["count", "", "x"], ["y"], body=body)],
        "endless",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1])],
        [onnx.numpy_helper.from_array(np.array(2**60, np.int64), "count")],
    )
    path = tmp_path / "endless.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), str(path))
    session = ModelSession(path, CPU)
    with pytest.raises(ModelError, match=r"the model failed: it ran for over 0\.2 s"):
        session.run(np.zeros(1, np.float32), "y")


def test_a_port_of_too_many_numbers_is_refused_unrun(tmp_path: Path) -> None:
    path = red_model(tmp_path / "huge.onnx", CARD, (1, 3, 32_000, 32_000))
    with pytest.raises(ConfigError, match=r"segmenter\.model is .*32000 x 32000 has more than 200000000 numbers"):
        ModelSession(path, CPU)
