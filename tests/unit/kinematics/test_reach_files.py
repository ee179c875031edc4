from __future__ import annotations

import os
import re
import shutil
import warnings
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, OutputError
from debrisgrasp.kinematics import (
    ArmReach,
    KinematicChain,
    ReachMap,
    ReachMapConfig,
    RobotModel,
    cache_folder,
    cached_reach_map,
    load_reach_map,
    reach_files,
    save_reach_map,
)

SMALL = ReachMapConfig(n_samples=4000, n_radius=6, n_height=8, n_rise=4, n_heading=6)


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DEBRISGRASP_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def small(arm: KinematicChain) -> ReachMap:
    return ReachMap.build(arm, SMALL)


def _assert_equal(one: ReachMap, other: ReachMap) -> None:
    for field in fields(ReachMap):
        np.testing.assert_equal(getattr(one, field.name), getattr(other, field.name))


def test_a_map_comes_back_as_it_was_saved(
    arm: KinematicChain, small: ReachMap, tmp_path: Path
) -> None:
    save_reach_map(small, tmp_path / "map.npz")
    _assert_equal(load_reach_map(tmp_path / "map.npz", arm), small)


def test_a_map_of_other_limits_or_another_tool_is_refused(
    arm: KinematicChain, small: ReachMap, roman: RobotModel, tmp_path: Path
) -> None:
    path = tmp_path / "map.npz"
    save_reach_map(small, path)
    upper = arm.upper.copy()
    upper[3] -= 0.2
    for other in (replace(arm, upper=upper), roman.chain("left")):
        with pytest.raises(ConfigError, match=r"limits or tool.*out of date"):
            load_reach_map(path, other)


def test_the_cache_is_filled_once_and_used_afterwards(
    arm: KinematicChain, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = cached_reach_map(arm, SMALL)
    (path,) = own_cache.iterdir()
    monkeypatch.setattr(ReachMap, "build", lambda *_: pytest.fail("built again"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _assert_equal(cached_reach_map(arm, SMALL), built)
    assert path.suffix == ".npz"


@pytest.mark.parametrize("damage", ["empty", "text", "cut", "flipped", "foreign"])
def test_a_damaged_or_foreign_file_is_replaced_with_a_warning(
    arm: KinematicChain, roman: RobotModel, own_cache: Path, damage: str
) -> None:
    built = cached_reach_map(arm, SMALL)
    (path,) = own_cache.iterdir()
    data = path.read_bytes()
    if damage == "foreign":
        other = cached_reach_map(roman.chain("left"), SMALL)
        save_reach_map(other, path)
    else:
        middle = len(data) // 2
        changed = {
            "empty": b"",
            "text": b"not a map",
            "cut": data[:middle],
            "flipped": data[:middle] + bytes([data[middle] ^ 255]) + data[middle + 1 :],
        }
        path.write_bytes(changed[damage])
    with pytest.warns(UserWarning, match="built again"):
        _assert_equal(cached_reach_map(arm, SMALL), built)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _assert_equal(cached_reach_map(arm, SMALL), built)


def test_what_is_no_map_is_told_in_our_words(
    arm: KinematicChain, small: ReachMap, tmp_path: Path
) -> None:
    path = tmp_path / "map.npz"
    save_reach_map(small, path)
    with np.load(path) as content:
        arrays = dict(content)
    contents = {
        "no arrays at all": lambda file: file.write(b"words"),
        "nothing": lambda _: None,
        "a single array": lambda file: np.save(file, np.zeros(3)),
        "objects": lambda file: np.savez(file, facts=np.array([{}])),
        "other content": lambda file: np.savez(file, T=np.eye(4)),
        "other content than": lambda file: np.savez(file, facts="{oops"),
        "other content than a": lambda file: np.savez(file, facts="[1]"),
        "other content than a map": lambda file: np.savez(file, facts=arrays["facts"]),
    }
    for words, write in contents.items():
        with path.open("wb") as file:
            write(file)
        with pytest.raises(ConfigError, match=f"got .*{words}") as caught:
            load_reach_map(path, arm)
        assert not re.search("pickle|Error|json|__init__", str(caught.value))


def test_a_map_of_another_version_is_refused(
    arm: KinematicChain,
    small: ReachMap,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(reach_files, "_maker", lambda: "0123")
        save_reach_map(small, tmp_path / "map.npz")
    with pytest.raises(ConfigError, match=r"version of the code.*out of date"):
        load_reach_map(tmp_path / "map.npz", arm)


def test_a_few_versions_of_the_code_share_the_cache_and_the_oldest_go(
    arm: KinematicChain,
    small: ReachMap,
    own_cache: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    n_built = 0

    def build(*_: object) -> ReachMap:
        nonlocal n_built
        n_built += 1
        return small

    monkeypatch.setattr(ReachMap, "build", build)
    versions = ["a", "b", "a", "b", "c", "d", "b", "c"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for second, version in enumerate(versions):
            monkeypatch.setattr(reach_files, "_maker", lambda version=version: version)
            cached_reach_map(arm, SMALL)
            for path in own_cache.glob(f"*-{version}.npz"):
                os.utime(path, (second, second))
    assert n_built == 4
    assert len(list(own_cache.iterdir())) == 3


@pytest.mark.parametrize("obstacle", ["file", "folder"])
def test_without_a_writable_cache_all_works(
    arm: KinematicChain, small: ReachMap, own_cache: Path, obstacle: str
) -> None:
    if obstacle == "file":
        own_cache.write_text("in the way")
    else:
        cached_reach_map(arm, SMALL)
        (path,) = own_cache.iterdir()
        path.unlink()
        path.mkdir()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _assert_equal(cached_reach_map(arm, SMALL), small)


def test_the_cache_follows_the_platform(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DEBRISGRASP_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache_folder() == Path("/somewhere/debrisgrasp")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/someone")
    monkeypatch.setattr("sys.platform", "linux")
    assert cache_folder() == Path("/home/someone/.cache/debrisgrasp")
    monkeypatch.setattr("sys.platform", "darwin")
    assert cache_folder() == Path("/home/someone/Library/Caches/debrisgrasp")
    monkeypatch.setattr(Path, "home", _no_home)
    assert cache_folder() is None


def _no_home() -> Path:
    raise RuntimeError("no home")


def test_a_missing_folder_is_named(
    small: ReachMap, roman: RobotModel, tmp_path: Path
) -> None:
    with pytest.raises(OutputError, match="none"):
        save_reach_map(small, tmp_path / "none" / "map.npz")
    with pytest.raises(ConfigError, match=r"none\.npz"):
        load_reach_map(tmp_path / "none.npz", roman.chain("right"))


def test_an_arm_takes_its_map_from_the_cache(
    roman: RobotModel, own_cache: Path, cache: Path
) -> None:
    if cache.is_dir():
        shutil.copytree(cache, own_cache)
    ArmReach(roman, "right").reach_map  # noqa: B018 built when first asked for
    assert any(own_cache.iterdir())
