"""What runs the segmenter: which provider each part of the model really got, and why a GPU is not used."""

from collections.abc import Iterator
from contextlib import closing
from importlib.metadata import packages_distributions, version

import numpy as np

from service.commands.check.finding import Finding, fail, ok, warn
from service.config.sections import Config, ConfigError, SegmenterConfig
from service.segmenters.accelerator.accelerator import AcceleratorState
from service.segmenters.accelerator.assignment import parts_text, short
from service.segmenters.accelerator.board import board_name, gpu_nodes, is_jetson
from service.segmenters.model_session import CPU, TENSORRT, accelerators, runtime
from service.segmenters.onnx import OnnxSegmenter
from service.segmenters.segment import ClassicalSegmenter, make_accelerator, make_segmenter

_MUCH = 0.2  # of a run's time: on the CPU it is no trifle any more
_MODULE = "onnxruntime"


def check_segmenter(config: Config) -> Iterator[Finding]:
    """Opens it as a flight does; a GPU is waited for, which takes minutes where an engine is built."""
    try:
        yield from _opened(config)
    except ConfigError as error:
        yield fail("segmenter", str(error), "")  # which says what would be right


def _opened(config: Config) -> Iterator[Finding]:
    settings, camera = config.segmenter, config.camera.camera()
    with closing(make_accelerator(settings, is_told=False)) as accelerator:
        if settings.kind == "onnx":
            yield from check_packages()
            if wanted := accelerators(settings.providers):
                yield ok("segmenter", f"{short(wanted[0])} is prepared: an engine may be built, which takes minutes")
        segmenter = make_segmenter(settings, camera, accelerator=accelerator)
        if isinstance(segmenter, OnnxSegmenter):
            accelerator.start()
            segmenter.settle(np.full((camera.height, camera.width, 3), 128, np.uint8))
            yield from _of_model(segmenter, settings)
        elif isinstance(segmenter, ClassicalSegmenter):
            said = "classical, which needs no model and finds far less than the one that ships, with more false"
            yield warn("segmenter", said, "leave segmenter.kind out, but for tests and where no model can run")
        else:
            yield ok("segmenter", segmenter.name)


def check_packages() -> list[Finding]:
    """Whether ONNX Runtime is installed once: its builds are packages of several names, with one module in them all."""
    names = sorted(set(packages_distributions().get(_MODULE, ())))
    if len(names) < 2:
        return []
    said = " and ".join(f"{name} {version(name)}" for name in names)
    both = "both" if len(names) == 2 else "all"
    mend = f"pip uninstall --yes {' '.join(names)}, then install the one for this computer (docs/gpu.md)"
    line = f"{said} are {both} installed, one module: the one written last runs, {runtime().__version__}"
    return [warn("segmenter", line, mend)]


def provider_findings(state: AcceleratorState) -> list[Finding]:
    """Of an accelerator that has settled: each provider that is not used, and what the one that is has got."""
    findings = [
        warn("segmenter", f"{name} is not used: {why}", _mend(name, why)) for name, why in state.refused.items()
    ]
    findings += [warn("engine", note, _engine_mend(note)) for note in state.notes]
    if state.state == "used" and state.parts:
        on_cpu = sum(part.share for part in state.parts if part.provider == CPU)
        said = parts_text(state.parts)
        if on_cpu > _MUCH:
            findings.append(
                warn(
                    "provider",
                    said,
                    "export the model anew with operators that the GPU's provider has: fixed sizes, no loops",
                )
            )
        else:
            findings.append(ok("parts", said))
    return findings


def _of_model(segmenter: OnnxSegmenter, settings: SegmenterConfig) -> Iterator[Finding]:
    state = segmenter.accelerator.state
    yield from provider_findings(state)
    if segmenter.provider != CPU:
        took = f", {state.run_ms:.1f} ms a run, ready after {state.took_s:.0f} s"
        yield ok("segmenter", segmenter.name + took)
    elif not state.refused and (mend := _unused_gpu(settings)):
        nodes = ", ".join(map(str, gpu_nodes()[:2])) or "in its device tree"
        yield warn("segmenter", f"{segmenter.name}, though this computer ({board_name()}) has a GPU: {nodes}", mend)
    else:
        yield ok("segmenter", segmenter.name)
    if settings.fp16 and segmenter.provider != TENSORRT:
        mend = "that is TensorRT's alone: leave the key out"
        yield warn("segmenter", f"segmenter.fp16 is true, and {short(segmenter.provider)} computes with 32 bits", mend)


def _unused_gpu(settings: SegmenterConfig) -> str:
    """How to have the GPU used; empty where there is none."""
    if not gpu_nodes() and not is_jetson():
        return ""
    if set(settings.providers) <= {CPU}:
        return "name them in segmenter.providers before the CPU's: TensorrtExecutionProvider, CUDAExecutionProvider"
    if is_jetson() and not gpu_nodes():
        return "hand its devices to this container or user (docs/gpu.md)"
    return f"install NVIDIA's build in place of onnxruntime {runtime().__version__}, which has none (docs/gpu.md)"


def _engine_mend(note: str) -> str:
    if "can be kept" in note:
        return "give the folder, and room on its disk, to the service's user"
    return "stop the service first" if "another process" in note else "nothing is to be done: it has been replaced"


def _mend(name: str, why: str) -> str:
    if not gpu_nodes():
        return (
            "this computer shows no NVIDIA GPU: load its driver, or take segmenter.providers = ['CPUExecutionProvider']"
        )
    if "not installed" in why:
        return "install the CUDA, cuDNN and TensorRT that this ONNX Runtime was built for (docs/gpu.md)"
    return f"the CPU does its work; mend it, or leave {name}ExecutionProvider out of segmenter.providers"
