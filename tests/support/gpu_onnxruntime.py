"""The real ONNX Runtime with a GPU's providers added to it, which run on the CPU and behave, or fail, as told.

A process that has the folder of `pretend` first on its path gets it when it imports onnxruntime, so that the process
with the GPU is the real one. What is pretended is the boundary alone: the list of providers and the session.
"""

import json
from pathlib import Path
from typing import Any

import onnxruntime
import pytest

TENSORRT, CUDA, CPU = "TensorrtExecutionProvider", "CUDAExecutionProvider", "CPUExecutionProvider"
ALL = (TENSORRT, CUDA, CPU)

_MODULE = """
import json, os, signal, sys, time
from pathlib import Path

here = Path(__file__).parent
sys.path.remove(str(here))
del sys.modules["onnxruntime"]
import onnxruntime as real
import numpy as np
sys.path.insert(0, str(here))  # for the processes that this one starts

how = json.loads((here / "how.json").read_text())
Session = real.InferenceSession

class Pretended(Session):
    def __init__(self, model, options=None, providers=(), **others):
        asked = dict(providers)
        with (here / "opened.jsonl").open("a") as file:
            file.write(json.dumps({"pid": os.getpid(), "asked": asked}) + "\\\\n")
        self.got = [name for name in asked if name not in how.get("lacking", ())]
        self.acts = how.get(self.got[0], {})
        for name in how.get("lacking", ()):
            if name in asked:
                print(f"[E:onnxruntime] [ONNXRuntimeError] : 1 : FAIL : Failed to load library lib{name}.so with "
                      "error: libcublas.so.13: cannot open shared object file", file=sys.stderr)
        if "while" in self.acts:
            while (here / self.acts["while"]).exists():
                time.sleep(0.01)
        if "opening" in self.acts:
            raise RuntimeError(self.acts["opening"])
        tensorrt = asked.get("TensorrtExecutionProvider", {})
        self.fp16 = self.got[0] == "TensorrtExecutionProvider" and tensorrt["trt_fp16_enable"] == "True"
        assert all(value in ("True", "False") for key, value in tensorrt.items() if key.endswith("enable")), tensorrt
        if self.got[0] == "TensorrtExecutionProvider" and "trt_engine_cache_path" in tensorrt:
            engine = Path(tensorrt["trt_engine_cache_path"]) / "TRTKernel_sm87.engine"
            with (here / "built.txt").open("a") as file:
                file.write("found\\\\n" if engine.exists() else "built\\\\n")
            if not engine.exists():
                engine.write_bytes(b"engine" * 1000)
        self.runs = 0
        super().__init__(model, options, providers=["CPUExecutionProvider"])

    def get_providers(self):
        return self.got

    def end_profiling(self):
        path = super().end_profiling()
        events = json.loads(Path(path).read_text())
        for event in events:
            if event.get("cat") == "Node" and event["args"].get("op_name") not in self.acts.get("leaves", ()):
                event["args"]["provider"] = self.got[0]
        Path(path).write_text(json.dumps(events))
        return path

    def run(self, names, given, options=None):
        self.runs += 1
        if self.runs >= self.acts.get("from_run", 1):
            if self.acts.get("kills"):
                os.kill(os.getpid(), signal.SIGSEGV)
            if "running" in self.acts:
                raise RuntimeError(self.acts["running"])
        if self.acts.get("hangs_at") == self.runs:
            time.sleep(3600.0)
        outputs = super().run(names, given, options)
        if self.runs >= self.acts.get("from_run", 1):
            outputs = [one * np.float32(self.acts.get("times", 1.0)) for one in outputs]
            outputs = [one + np.float32(self.acts.get("adds", 0.0)) for one in outputs]
            outputs = [one[..., :: self.acts.get("each", 1)] for one in outputs]
        return [one.astype(np.float16).astype(np.float32) for one in outputs] if self.fp16 else outputs

real.InferenceSession = Pretended
real.get_available_providers = lambda: list(how["providers"])
sys.modules["onnxruntime"] = real
"""


class Pretence:
    """What was asked of it, by any process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def opened(self) -> list[dict[str, Any]]:
        """Each session: the process and the providers with their options."""
        path = self.folder / "opened.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    def built(self) -> list[str]:
        """For each session with a folder for engines, whether one was `built` or `found`."""
        path = self.folder / "built.txt"
        return path.read_text().split() if path.exists() else []


def pretend(monkeypatch: pytest.MonkeyPatch, folder: Path, providers: tuple[str, ...] = ALL, **how: Any) -> Pretence:
    """From now on ONNX Runtime has these providers, here and in processes that are started.

    `how` says by a provider's name how it behaves: `opening` or `running` is the error that it raises (the latter
    `from_run` on), `kills` ends its process then, `hangs_at` a run, `while` a file is there opening takes that long,
    `adds` is added to what it gives, which is multiplied by `times` and of which `each` so-manieth column is left
    (`from_run` on, too), and the CPU gets the kinds of nodes that it `leaves`. `lacking` names those that cannot be
    loaded.
    """
    folder.mkdir(exist_ok=True)
    (folder / "onnxruntime.py").write_text(_MODULE.replace("\\\\n", "\\n"))
    (folder / "how.json").write_text(json.dumps({"providers": providers, **how}))
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: list(providers))
    return Pretence(folder)
