"""The choice of a render window survives machines where none works."""

import subprocess
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from mixpinn.evaluation import RenderingUnavailable, start_rendering
from mixpinn.evaluation import rendering_backend as backend


@pytest.fixture(autouse=True)
def _forget(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    # setenv before delenv makes monkeypatch restore whatever start_rendering leaves behind.
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "")
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(backend.sys, "platform", "linux")
    backend._working_window.cache_clear()
    yield
    backend._working_window.cache_clear()


def trials(monkeypatch: pytest.MonkeyPatch, works: str | None) -> list[str]:
    """Let only the window `works` draw; return the list that records what was tried."""
    tried: list[str] = []

    def run(*_: Any, env: dict[str, str], **__: Any) -> SimpleNamespace:
        window = env.get("VTK_DEFAULT_OPENGL_WINDOW", "")
        tried.append(window)
        # A missing library ends the process by a signal: a negative return code.
        return SimpleNamespace(returncode=0 if window == works else -11)

    monkeypatch.setattr(subprocess, "run", run)
    return tried


def test_off_screen_windows_are_tried_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = trials(monkeypatch, "vtkOSOpenGLRenderWindow")
    start_rendering()
    assert tried == ["vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"]
    assert backend.os.environ["VTK_DEFAULT_OPENGL_WINDOW"] == "vtkOSOpenGLRenderWindow"
    start_rendering()
    assert len(tried) == 2


def test_a_display_is_preferred(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    tried = trials(monkeypatch, "")
    start_rendering()
    assert tried == [""]


def test_no_window_at_all_is_said_clearly(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = trials(monkeypatch, None)
    with pytest.raises(RenderingUnavailable, match="off-screen OpenGL"):
        start_rendering()
    assert len(tried) == 3
