"""Signing keys: where they may come from, who may read them, and that nothing ever prints one."""

from __future__ import annotations

import hashlib
import io
import stat

import pytest

from gcs.cli.entry import main
from gcs.keys import KeyFileError, SigningKey, default_path, read_key, write_key

SECRET = bytes(range(32))


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "keys" / "signing.key"
    write_key(path, SigningKey(SECRET))
    return path


def test_a_key_is_written_for_its_owner_alone_and_read_back(path):
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert path.read_text() == SECRET.hex() + "\n"  # what other tools can read
    assert read_key(path).secret == SECRET


@pytest.mark.parametrize("mode", [0o640, 0o620, 0o604, 0o602, 0o660, 0o666, 0o610])
def test_a_file_open_to_others_is_refused_with_the_remedy(path, mode):
    path.chmod(mode)
    with pytest.raises(KeyFileError, match=rf"run: chmod 600 {path}$"):
        read_key(path)


@pytest.mark.parametrize(
    "text", ["", "00" * 32, SECRET.hex()[:-1], SECRET.hex() + "00", SECRET.hex()[:-2] + "zz", "\xff" * 64, "a" * 5000]
)
def test_a_file_without_a_key_is_refused_and_not_quoted(path, text):
    path.write_text(text, "latin-1")
    with pytest.raises(KeyFileError) as caught:
        read_key(path)
    assert "\n" not in str(caught.value)
    assert not text or text not in str(caught.value)


def test_missing_or_odd_files_are_refused(tmp_path):
    with pytest.raises(KeyFileError, match="no such file"):
        read_key(tmp_path / "none.key")
    with pytest.raises(KeyFileError, match="directory"):
        read_key(tmp_path)


def test_the_key_itself_instead_of_its_path_is_refused_and_not_repeated(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for action in (read_key, lambda path: write_key(path, SigningKey(SECRET))):
        with pytest.raises(KeyFileError, match="path of the key's file") as caught:
            action(tmp_path / SECRET.hex())
        assert SECRET.hex() not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_key_is_never_overwritten(path):
    with pytest.raises(KeyFileError, match="exists already"):
        write_key(path, SigningKey.random())
    assert read_key(path).secret == SECRET


def test_a_key_does_not_show_in_text():
    key = SigningKey(SECRET)
    assert SECRET.hex() not in repr(key) + str(key) + key.fingerprint
    assert str(SECRET) not in repr(key)
    assert key.fingerprint == SigningKey(SECRET).fingerprint != SigningKey(SECRET[::-1]).fingerprint
    assert SigningKey.random().secret != SigningKey.random().secret


def test_a_passphrase_gives_the_key_that_other_stations_derive():
    text = "correct horse battery staple"
    assert SigningKey.from_passphrase(text).secret == hashlib.sha256(text.encode()).digest()
    with pytest.raises(KeyFileError, match="at least 12"):
        SigningKey.from_passphrase("too short")


def test_new_and_show_fingerprint(tmp_path, capsys, monkeypatch):
    path = tmp_path / "a.key"
    assert main(["keys", "new", str(path)]) == 0
    out = capsys.readouterr().out
    key = read_key(path)
    assert key.fingerprint in out
    assert "gcs keys send" in out
    assert key.secret.hex() not in out
    assert main(["keys", "show-fingerprint", str(path)]) == 0
    assert key.fingerprint in capsys.readouterr().out
    assert main(["keys", "new", str(path)]) == 2
    assert "exists already" in capsys.readouterr().err
    path.chmod(0o644)
    assert main(["keys", "show-fingerprint", str(path)]) == 2
    assert f"chmod 600 {path}" in capsys.readouterr().err


def test_a_passphrase_is_read_from_a_pipe(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("correct horse battery staple\n"))
    path = tmp_path / "b.key"
    assert main(["keys", "new", "--passphrase", str(path)]) == 0
    assert read_key(path) == SigningKey.from_passphrase("correct horse battery staple")
    assert "correct" not in capsys.readouterr().out


def test_the_default_path_is_in_the_users_configuration(monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", "/somewhere")
    assert str(default_path()) == "/somewhere/climrt-gcs/signing.key"
    monkeypatch.delenv("XDG_CONFIG_HOME")
    assert default_path().parts[-3:] == (".config", "climrt-gcs", "signing.key")
