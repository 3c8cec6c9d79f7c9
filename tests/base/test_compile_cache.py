"""No home, another user, an install that cannot be written: a folder is found all the same."""

import os
from pathlib import Path

import numba
import pytest
from numba.core.dispatcher import Dispatcher

from mixpinn.base import compile_cache
from mixpinn.base.cache import cache_folder, optional_cache
from mixpinn.base.errors import InputError
from mixpinn.base.files import is_foreign


@pytest.fixture
def nowhere(monkeypatch, tmp_path):
    for name in ("XDG_CACHE_HOME", "MIXPINN_CACHE", "NUMBA_CACHE_DIR", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(compile_cache.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(compile_cache.os, "access", lambda path, mode: str(path).startswith(str(tmp_path)))

    def no_home():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", no_home)
    return tmp_path


def test_caches_without_a_home(nowhere):
    assert cache_folder("a").is_relative_to(nowhere)
    compile_cache.settle_compile_cache()
    assert os.environ["NUMBA_CACHE_DIR"].startswith(str(nowhere))
    os.environ.pop("NUMBA_CACHE_DIR")


def test_what_is_set_is_kept(nowhere, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(nowhere / "kernels"))
    monkeypatch.setenv("MIXPINN_CACHE", str(nowhere / "given"))
    compile_cache.settle_compile_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == str(nowhere / "kernels")
    assert cache_folder("a") == nowhere / "given" / "a"
    (nowhere / "file").write_text("x")
    monkeypatch.setenv("MIXPINN_CACHE", str(nowhere / "file"))
    with pytest.raises(InputError):
        cache_folder("a")


def test_a_place_that_cannot_be_written_is_not_kept(nowhere, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/elsewhere")
    compile_cache.settle_compile_cache()
    assert os.environ["NUMBA_CACHE_DIR"].startswith(str(nowhere))
    (nowhere / "file").write_text("x")
    monkeypatch.setenv("MIXPINN_CACHE", str(nowhere / "file" / "cache"))
    with pytest.raises(InputError, match="file/cache"):
        optional_cache("a")


def test_without_any_place_kernels_are_compiled_and_not_kept(nowhere, monkeypatch):
    def none():
        raise FileNotFoundError

    monkeypatch.setattr(compile_cache.os, "access", lambda path, mode: False)
    monkeypatch.setattr(compile_cache.tempfile, "gettempdir", none)
    monkeypatch.setattr(Dispatcher, "enable_caching", Dispatcher.enable_caching)  # given back afterwards
    (nowhere / "file").write_text("x")
    monkeypatch.setattr(compile_cache, "_temporary", lambda kind: nowhere / "file" / kind)
    compile_cache.settle_compile_cache()
    assert "NUMBA_CACHE_DIR" not in os.environ

    @numba.njit(cache=True)
    def double(x):
        return 2 * x

    assert double(3) == 6
    assert type(double._cache).__name__ == "NullCache"
    assert optional_cache("a") is None


def test_files_of_file_managers():
    assert all(map(is_foreign, (".DS_Store", "._zarr.json", "Thumbs.db", "desktop.ini", ".writing-1")))
    assert not any(map(is_foreign, ("zarr.json", "c", "0", "run.json")))
