"""The demo's page: served beside it and ended with it; a line says what lacks where the extra is not installed."""

import importlib.util
import urllib.request
from pathlib import Path

import pytest

from service.commands.demo import page
from tests.support.ports import free_port


def test_it_is_served_while_the_demo_flies_and_its_address_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(page.webbrowser, "open", opened.append)
    monkeypatch.setenv("DISPLAY", ":0")
    said: list[str] = []
    with page.crew_page(f"tcp/127.0.0.1:{free_port()}", tmp_path / "ground.log", said.append):
        (address,) = opened
        assert said == [f"the picture is at {address}"]
        with urllib.request.urlopen(address) as answer:
            assert b"<title>distloc" in answer.read()
    with pytest.raises(OSError):
        urllib.request.urlopen(address)


def test_without_the_extra_the_demo_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    said: list[str] = []
    with page.crew_page("tcp/127.0.0.1:1", tmp_path / "ground.log", said.append):
        assert len(said) == 1 and "pip install '.[ground]'" in said[0]


def test_a_bare_unix_has_no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert not page.has_display()
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert page.has_display()
