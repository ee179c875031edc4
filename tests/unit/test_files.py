"""Settings complain with line numbers; results are written whole or not at all."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from threading import Thread

import pytest

from debrisgrasp._files import (
    data_path,
    read_json,
    read_yaml,
    require_folder,
    require_own,
    require_picture,
    require_writable,
    write_atomic,
    yaml_files,
)
from debrisgrasp._unreadable import is_pointer
from debrisgrasp._words import as_text
from debrisgrasp.errors import ConfigError, OutputError


def test_shipped_data_are_found():
    assert data_path("prototypes").is_dir()
    assert data_path("robots", "roman.yaml").parent.name == "robots"


def test_yaml_and_json_are_read(tmp_path):
    (tmp_path / "a.yaml").write_text("width: 0.05\nnames: [a, b]\n")
    (tmp_path / "a.json").write_text('{"width": 0.05, "names": ["a", "b"]}')
    expected = {"width": 0.05, "names": ["a", "b"]}
    assert read_yaml(tmp_path / "a.yaml") == expected
    assert read_json(tmp_path / "a.json") == expected


def test_yaml_files_of_a_folder_are_those_that_a_person_sees(tmp_path):
    for name in ("b.yml", "a.YAML", "._a.yaml", "a.ply", "notes.txt"):
        (tmp_path / name).write_text("")
    assert [file.name for file in yaml_files(tmp_path, "hands")] == ["a.YAML", "b.yml"]
    with pytest.raises(ConfigError, match=r"no such file or folder.*hands"):
        yaml_files(tmp_path / "nowhere", "hands")
    with pytest.raises(ConfigError, match="Not a directory"):
        yaml_files(tmp_path / "notes.txt", "hands")


@pytest.mark.parametrize(
    ("make", "kind"), [(os.mkdir, "a folder"), (os.mkfifo, "a pipe or a device")]
)
def test_what_only_has_the_name_of_a_file_is_not_waited_for(tmp_path, make, kind):
    make(tmp_path / "x.yaml")
    with pytest.raises(ConfigError, match=f"x.yaml: got {kind}, .* a file of hands"):
        yaml_files(tmp_path, "hands")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "a: 1\nb: [1, 2\nc: 3\n", r"a.yaml, line \d"),
        ("a.yaml", "a: 1\n\tb: 2\n", "a.yaml, line 2"),
        ("a.yaml", "a:\n\tb: 2\n", "a.yaml, line 2: .*[Ii]ndent by spaces"),
        ("a.yaml", "a: b: c\n", "a.yaml, line 1: got a second colon.*quote"),
        ("a.yaml", "a: [1, 2\nb: 3\n", "a bracket that is not closed"),
        ("a.yaml", "a:\n  - 1\n - 2\n", "line 3: got a line.*Indent all"),
        ("a.yaml", 'a: 1\nb "x\nc: 3\n', "a field without a colon.*`field: value`"),
        ("a.yaml", "a: 1\nday: 2026-13-45", "line 2: got '2026-13-45'.*no date"),
        ("a.yaml", "a: 1\nb: !!timestamp foo", "line 2: got 'foo', .*no date"),
        ("a.yaml", "a: !!int foo", "got 'foo', which is no whole .*Quote"),
        ("a.yaml", "a: !!set [1]", "line 1: got a value of another kind"),
        ("a.yaml", "a: 1\n? [1, 2]\n: 3", "line 2: got a list .*name of a field"),
        ("a.yaml", "a: 1\n{b: 2}: 3", "line 2: got a list or fields .*name"),
        ("a.yaml", "a: 1\nb: {[c]: 2}", "line 2: got a list .*name of a field"),
        ("a.yaml", "<<: {[a]: 2}", "line 1: got a list .*name of a field"),
        ("a.yaml", "a: 1\n<<: 3", "line 2: got << before something"),
        ("a.yaml", "a: !!bool foo", "got 'foo', which is neither true nor false"),
        ("a.yaml", "a: !!int ''", "line 1: got '', which is no whole number"),
        ("a.yaml", "a: 1\nb: !!int {=: x}", "line 2: got a value of another kind"),
        ("a.yaml", "a: !!binary x", "line 1: got letters that are no base64"),
        ("a.yaml", "a: 1\nb: =", "line 2: got a lone =.*Quote"),
        ("a.yaml", "a: *b", r"line 1: got a \* .*Quote it"),
        ("a.yaml", "a: &b 1\nc: &b 2", "line 2: got a name after & a second"),
        ("a.yaml", 'a: "C:\\xfoo"', "line 1: got a backslash .*single quotes"),
        ("a.yaml", "- a\nb: 3", "line 2: got a line that belongs to no entry"),
        ("a.yaml", "a: 1\nb: \a", r"line 2: got a character that can't be seen"),
        ("a.yaml", "a: " + "[" * 150 + "]" * 150, "a.yaml: got too many brackets"),
        ("a.yaml", "a: 1\n---\nb: 2", "line 2: got a second document"),
        ("a.yaml", "[" * 3000, "a.yaml: got too many brackets"),
        ("a.yaml", "a: 1\nb: {x: 1,\n x: 2}\n", "a.yaml, line 3.*'x' a second time"),
        ("a.yaml", "!!python/object/apply:os.getcwd []", "a.yaml, line 1"),
        ("a.json", '{"a": 1,\n "b": }', "a.json, line 2"),
        ("a.json", '{"a": NaN}', "NaN"),
        ("a.json", "[" * 100_000, "a.json: got too many brackets"),
        ("a.json", "[" * 600 + "]" * 600, "a.json: got too many brackets"),
        ("a.json", "9" * 5000, "a.json: got a number of too many digits"),
        ("a.json", "9" * 400, "a.json: got a number of too many digits"),
        ("a.json", "", "a.json, line 1"),
    ],
)
def test_malformed_settings_name_file_and_line(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=message):
        (read_yaml if name.endswith("yaml") else read_json)(tmp_path / name)


def test_what_lies_in_itself_or_is_named_often_does_not_hang(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("a: &a [*a]\n")
    assert len(read_yaml(path)["a"]) == 1
    doubled = [f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 60)]
    path.write_text("\n".join(["a0: &a0 [1]", *doubled]))
    with pytest.raises(ConfigError, match=r"a.yaml: got names .* at most 1000000 val"):
        read_yaml(path)
    path.write_text("\n".join(["a0: &a0 [1]", *doubled[:9]]))
    assert len(read_yaml(path)) == 10


def test_a_device_has_no_end_and_is_not_read():
    with pytest.raises(ConfigError, match="/dev/zero: got a device"):
        read_yaml("/dev/zero")


@pytest.mark.parametrize("content", [b"width: 0.05\n", b"\xff\xfe", b"PK\x05\x06\xff"])
def test_a_pipe_has_an_end_and_is_read(tmp_path, content):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = Thread(target=pipe.write_bytes, args=(content,))
    writer.start()
    if content.startswith(b"width"):
        assert read_yaml(pipe) == {"width": 0.05}
    else:
        with pytest.raises(ConfigError, match="UTF-8"):
            read_yaml(pipe)
    writer.join()


@pytest.mark.parametrize("write", [write_atomic, require_writable, require_folder])
def test_results_have_no_name_that_no_file_can_have(tmp_path, write):
    place = tmp_path / ("x" * 300) / "inside"
    for path in (place, place.parent):
        with pytest.raises(OutputError, match="too long"):
            write(path, *["new"] * (write is write_atomic))
        assert not is_pointer(path)
    assert list(tmp_path.iterdir()) == []


def test_a_name_with_a_zero_byte_is_no_file():
    with pytest.raises(ConfigError, match="zero byte in its name"):
        read_yaml("a\0.yaml")
    for write in (require_folder, require_writable, partial(write_atomic, data="")):
        with pytest.raises(OutputError, match="zero byte in its name"):
            write("a\0.yaml")


@pytest.mark.parametrize("read", [read_yaml, read_json])
def test_missing_files_folders_and_binary_files_are_refused(tmp_path, read):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x81")
    odd = {"none": "No such file", "": "got a folder", 300 * "x": "too long"}
    for name, message in odd.items():
        with pytest.raises(ConfigError, match=message):
            read(tmp_path / name)
    with pytest.raises(ConfigError, match="UTF-8"):
        read(tmp_path / "binary")


def test_writing_replaces_the_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "plan.json"
    write_atomic(path, "old")
    write_atomic(path, b"new")
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "plan.json"
    write_atomic(path, "old")

    def no_space(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(OutputError, match="No space left"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("mode", [0o600, 0o640])
def test_a_file_that_is_replaced_keeps_its_permissions(tmp_path, mode):
    path = tmp_path / "plan.json"
    write_atomic(path, "old")
    path.chmod(mode)
    write_atomic(path, "new")
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == mode


def test_a_name_that_is_no_text_is_written_as_a_sign():
    assert as_text("bad\udcff") == "bad?"


def test_text_that_is_no_text_is_written_all_the_same(tmp_path):
    write_atomic(tmp_path / "a.html", "<h1>bad\udcff</h1>")
    assert (tmp_path / "a.html").read_text() == "<h1>bad?</h1>"


def test_a_mark_of_byte_order_is_no_part_of_the_text(tmp_path):
    for name, read in (("a.yaml", read_yaml), ("a.json", read_json)):
        (tmp_path / name).write_text('{"width": 0.05}', encoding="utf-8-sig")
        assert read(tmp_path / name) == {"width": 0.05}


def test_only_what_can_be_made_writable_is_asked_to_be(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="give another place") as caught:
        write_atomic(tmp_path, "new")
    assert "writable" not in str(caught.value)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match="make this one writable"):
        write_atomic(tmp_path / "file", "new")


def test_a_result_replaces_its_own_kind_only(tmp_path):
    own = tmp_path / "own.json"
    for text in ("", '{"schema": "debrisgrasp/grasps/0"}'):
        own.write_text(text)
        require_own(own, "debrisgrasp/grasps/1")
    for text in ("[1]", '{"schema": "debrisgrasp/motion/1"}', "\x00"):
        own.write_text(text)
        with pytest.raises(OutputError, match="would be lost"):
            require_own(own, "debrisgrasp/grasps/1")
    with pytest.raises(ConfigError, match=r"name of a plan: got .*ends in \.json"):
        require_own(tmp_path / "own.txt", "debrisgrasp/grasps/1", "a plan")


def test_a_pipe_is_not_looked_into(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    require_picture(tmp_path / "pipe.png", (".png",), "a picture")


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    link.symlink_to(target)
    write_atomic(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_places_that_can_not_be_written_are_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("x")
    for place in (tmp_path, tmp_path / "none" / "x", tmp_path / "file" / "x"):
        with pytest.raises(OutputError):
            write_atomic(place, "new")
    with pytest.raises(OutputError, match="regular"):
        write_atomic(Path(os.devnull), "new")
    with pytest.raises(OutputError, match="--json"):
        write_atomic("-", "new")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match="write-protected"):
        write_atomic(tmp_path / "file", "new")
    assert (tmp_path / "file").read_text() == "x"
