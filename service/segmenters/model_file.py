"""Which kind of model a file is, where it is none in ONNX; model_session.py asks before it opens one."""

from pathlib import Path

_LOOKED_AT = 16  # bytes
_CONTENTS = {
    b"PK\x03\x04": "a PyTorch checkpoint or another archive",
    b"\x89HDF": "a Keras model (HDF5)",
    b"ftrt": "a TensorRT engine",
    b"<?xm": "an OpenVINO model",
}
_SUFFIXES = {
    ".tflite": "a TFLite model",
    ".lite": "a TFLite model",
    ".pt": "a PyTorch checkpoint",
    ".pth": "a PyTorch checkpoint",
    ".torchscript": "a TorchScript model",
    ".h5": "a Keras model",
    ".keras": "a Keras model",
    ".pb": "a TensorFlow graph",
    ".engine": "a TensorRT engine",
    ".plan": "a TensorRT engine",
    ".mlmodel": "a CoreML model",
    ".mlpackage": "a CoreML model",
    ".safetensors": "weights without a network",
    ".param": "an NCNN model",
    ".mnn": "an MNN model",
}
SUFFIXES = frozenset({".onnx", *_SUFFIXES})


def other_kind(path: Path) -> str:
    """What it is instead of a model in ONNX, by its first bytes and its name; empty: nothing else that is known."""
    try:
        with path.open("rb") as file:
            head = file.read(_LOOKED_AT)
    except OSError:
        head = b""
    if head[4:8] == b"TFL3":
        return "a TFLite model"
    return next((kind for start, kind in _CONTENTS.items() if head.startswith(start)), "") or _SUFFIXES.get(
        path.suffix.lower(), ""
    )
