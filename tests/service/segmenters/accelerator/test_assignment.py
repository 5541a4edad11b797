"""Which provider each part of a model got, from a profile: nodes, pieces and shares of the time."""

from pathlib import Path
from typing import Any

from service.segmenters.accelerator.assignment import parts_of_events, parts_of_profile, parts_text
from service.segmenters.model_session import CPU, ModelSession, Tuning
from tests.support.gpu_onnxruntime import CUDA, TENSORRT
from tests.support.onnx_models import CARD, red_model


def ran(provider: str, kind: str, took_us: int, name: str = "n_kernel_time") -> dict[str, Any]:
    return {"cat": "Node", "name": name, "dur": took_us, "args": {"provider": provider, "op_name": kind}}


def test_a_graph_that_falls_back_in_pieces() -> None:
    events = [
        {"cat": "Session", "name": "model_loading", "dur": 9000},
        ran(TENSORRT, "TRTKernel_1", 600),
        ran(CUDA, "MemcpyToHost", 500),
        ran(CPU, "Resize", 100),
        ran(CPU, "Resize", 100),
        ran(TENSORRT, "TRTKernel_2", 100),
        ran(CPU, "Cast", 100),
        ran(CPU, "Cast", 900, name="n_fence_before"),
        {"cat": "Node", "name": "odd_kernel_time"},
    ]
    first, second = parts_of_events(events)
    assert (first.provider, first.nodes, first.pieces, first.share) == (TENSORRT, 2, 2, 0.7)
    assert (second.provider, second.nodes, second.pieces, second.kinds) == (CPU, 3, 2, ("Resize", "Cast"))
    assert parts_text((first, second)) == (
        "Tensorrt 2 nodes in 2 pieces (70% of the time), CPU 3 nodes in 2 pieces (30%: Resize, Cast)"
    )


def test_a_real_profile_is_read(tmp_path: Path) -> None:
    import numpy as np

    path = red_model(tmp_path / "red.onnx", CARD)
    session = ModelSession(path, (CPU,), tuning=Tuning(profile=str(tmp_path / "profile")))
    session.outputs_of(np.zeros((1, 3, 32, 64), np.float32), ["odd/name:0"])
    (part,) = parts_of_profile(session.end_profile())
    assert part.provider == CPU and part.share == 1.0 and part.pieces == 1 and "Conv" in part.kinds


def test_what_is_no_profile_tells_nothing(tmp_path: Path) -> None:
    (tmp_path / "broken").write_text('[{"cat":')
    assert parts_of_profile(tmp_path / "broken") == parts_of_profile(tmp_path / "none") == ()
    assert parts_text(()) == ""
