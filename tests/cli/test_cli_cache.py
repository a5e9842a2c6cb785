"""`jounce cache`: what it counts, what it removes, and what it leaves alone."""

import os

import pytest

import jounce
from jounce.native import cache
from support.abandoned import abandoned_part
from support.commands import call, summary
from support.refusals import refused

CODE = {"a" * 64: b"code", "b" * 64: b"more code"}


@pytest.fixture
def new_cache(tmp_path, monkeypatch):
    """A cache that does not exist yet."""
    monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path / "kernels"))
    return tmp_path / "kernels"


@pytest.fixture
def filled(new_cache):
    for name, code in CODE.items():
        cache.write(name, code)
    (new_cache / "notes.txt").write_text("mine")
    (new_cache / f"folder{cache.KERNEL_SUFFIX}").mkdir()
    (new_cache / f"link{cache.KERNEL_SUFFIX}").symlink_to(new_cache / "notes.txt")
    return new_cache


def test_it_counts_kernels_alone(filled):
    size = sum((filled / (name + cache.KERNEL_SUFFIX)).stat().st_size for name in CODE)
    expected = {"folder": str(filled), "private": True, "cleared": False, "kernels": 2, "bytes": size, "limit": 2**28}
    expected["obstacle"] = None
    assert summary("cache") == expected
    assert call("cache").stdout == f"{filled}\nkernels kept: 2, {size} bytes of at most {2**28}\n"


def test_it_removes_kernels_alone(filled):
    before, others = summary("cache"), {path for path in filled.iterdir() if path.stem not in CODE}
    assert summary("cache", "--clear") == before | {"cleared": True}
    assert set(filled.iterdir()) == others
    assert (filled / "notes.txt").read_text() == "mine"
    assert all(cache.read(name) is None for name in CODE)
    assert summary("cache", "--clear")["kernels"] == 0


def test_it_shows_the_limit_that_is_set(filled, monkeypatch):
    monkeypatch.setenv("JOUNCE_CACHE_SIZE", "0.5")
    assert summary("cache")["limit"] == 2**19


@pytest.mark.parametrize("set_to", ["much", "-1", "nan", "inf", "1_0", "x" * 200])
def test_a_limit_that_is_no_size_is_refused(filled, monkeypatch, set_to):
    monkeypatch.setenv("JOUNCE_CACHE_SIZE", set_to)
    assert len(refused(filled, ["cache"], f"^JOUNCE_CACHE_SIZE is '{set_to[:80]}")) < 200


@pytest.mark.skipif(not hasattr(os, "uname"), reason="which processes are gone cannot be told on Windows")
def test_it_removes_files_of_killed_writers_not_of_active_ones(filled):
    gone, live, mine = abandoned_part(filled), abandoned_part(filled, os.getpid()), filled / "notes.part"
    mine.touch()
    summary("cache", "--clear")
    assert (gone.exists(), live.exists(), mine.exists()) == (False, True, True)


@pytest.mark.parametrize("words", [(), ("--clear",)])
def test_a_folder_that_is_missing_holds_none_and_is_not_made(new_cache, words):
    assert (summary("cache", *words)["kernels"], summary("cache", *words)["private"]) == (0, True)
    assert not new_cache.exists()


def test_what_a_robot_compiles_is_there_at_once(new_cache):
    fresh = jounce.load("planar2r", L1=0.123, m2=4.56)  # compiled by no other test
    fresh.compile(order=1)
    assert summary("cache")["kernels"] == 1


def writable_by_others(filled):
    filled.chmod(0o777)


def led_elsewhere(filled):
    elsewhere = filled.with_name("elsewhere")
    filled.rename(elsewhere)
    filled.symlink_to(elsewhere)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows keeps users' folders apart itself")
@pytest.mark.parametrize(("spoilt", "reason"), [
    (writable_by_others, "others may write into the cache folder; make it private (mode 0700)"),
    (led_elsewhere, "it is a link, not a folder; JOUNCE_CACHE_DIR selects another"),
])  # fmt: skip
def test_a_folder_that_is_not_private_is_told_and_not_cleared(filled, spoilt, reason):
    spoilt(filled)
    assert (summary("cache")["private"], summary("cache")["kernels"]) == (False, 2)
    assert call("cache").stdout.endswith(f"not used: {reason}\n")
    refused(filled, "cache --clear", f"^{filled}: {reason}$")


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows keeps users' folders apart itself")
def test_a_folder_of_another_user_is_named(filled, monkeypatch):
    monkeypatch.setattr(os, "getuid", lambda: filled.stat().st_uid + 1)
    words = "the cache folder belongs to another user; JOUNCE_CACHE_DIR selects another"
    assert call("cache").stdout.endswith(f"not used: {words}\n")


@pytest.mark.parametrize("words", [(), ("--clear",)])
def test_a_file_in_place_of_the_folder(new_cache, words):
    new_cache.write_text("a file")
    result = call("cache", *words)
    assert result.exit_code == (2 if words else 0)
    assert new_cache.read_text() == "a file"


def test_a_file_or_link_in_the_place_of_the_folder_is_named(tmp_path, monkeypatch):
    path = tmp_path / "kernels"
    path.write_text("")
    for place, words in (
        (path, "it is a file, not a folder; JOUNCE_CACHE_DIR selects another"),
        (path / "below", "the cache folder cannot be used: Not a directory; JOUNCE_CACHE_DIR selects another"),
    ):
        monkeypatch.setenv("JOUNCE_CACHE_DIR", str(place))
        assert call("cache").stdout.endswith(f"not used: {words}\n")
        assert f"{place}: {words}" in call("cache", "--clear").output


def test_a_copy_without_a_digest_of_its_code_says_that_it_keeps_none(filled, monkeypatch):
    monkeypatch.setattr(cache, "code_digest", lambda *layers: None)
    assert (summary("cache")["private"], summary("cache")["obstacle"]) == (True, cache.UNKNOWN_CODE)
    assert call("cache").stdout.endswith(f"not used: {cache.UNKNOWN_CODE}\n")
    assert summary("cache", "--clear")["kernels"] == 2
