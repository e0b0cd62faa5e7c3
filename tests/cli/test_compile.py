"""`navstack compile`, and what commands show while kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable, Collection

import pytest

from navstack.cli.app import run


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Collection[str] | None]:
    """The uses whose kernels were wanted; two of three kernels are missing."""
    asked: list[Collection[str] | None] = []

    def compile_ahead(uses: Collection[str] | None, progress: Callable[[int, int], None], *, required: bool) -> int:
        assert required
        asked.append(uses)
        for done in range(3):
            progress(done, 2)
        return 2

    monkeypatch.setattr("navstack.core.compile_ahead", compile_ahead)
    return asked


def test_all_kernels_or_those_of_some_plugins(
    asked: list[Collection[str] | None], capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(["compile"]) == run(["compile", "--all"]) == run(["compile", "dwa", "navfn"]) == 0
    assert asked == [None, None, ["dwa", "navfn"]]
    out, err = capfd.readouterr()
    assert out.count("2 specializations compiled; the cache is ") == 3
    assert err.count("note: compiling kernels") == 3  # once per command


def test_wrong_names_are_reported(asked: list[Collection[str] | None], capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["compile", "dwaa"]) == run(["compile", "--all", "dwa"]) == 2
    err = capfd.readouterr().err
    assert 'no kernels are recorded for "dwaa"; known are: ' in err and "exclude each other" in err
    assert not asked
