"""The compiler's cache for live pages, which is filled when FMUs are built."""

from __future__ import annotations

from desat.system.errors import DesatError
from desat.web import module


def test_the_cache_is_filled_by_an_empty_module(monkeypatch):
    modules = []
    compile_module = module.compiled
    monkeypatch.setattr(
        module, "compiled", lambda texts: modules.append(compile_module(texts))
    )
    module.fill_cache()
    assert [m[:4] for m in modules] == [b"\0asm"]


def test_without_a_compiler_there_is_no_cache(monkeypatch):
    def fail() -> None:
        raise DesatError("no compiler")

    monkeypatch.setattr(module, "need_compiler", fail)
    module.fill_cache()
