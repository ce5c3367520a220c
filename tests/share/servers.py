"""Servers on this machine alone, that keep what DVC pushes: a real sshd, and an S3 server."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

KEY = "test-access-key"
SECRET = "test-secret-key"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def sshd(folder: Path, home: Path) -> Iterator[str]:
    """Start an sshd with keys of its own that lets in the key under ``home``; yield the address of ``folder``.

    Skips where there is no sshd or DVC has no plug-in for it.
    """
    pytest.importorskip("dvc_ssh", reason="dvc-ssh is not installed (pip install -e '.[remotes]')")
    program = shutil.which("sshd", path=f"{os.environ['PATH']}:/usr/sbin:/usr/local/sbin")
    if program is None:
        pytest.skip("there is no sshd on this machine (Debian: apt-get install openssh-server)")
    if os.geteuid() == 0:  # sshd confines itself to this empty folder; only root needs it
        Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)
    own, ours = folder / "sshd", home / ".ssh"
    for place in (own, ours, folder / "storage"):
        place.mkdir(parents=True, mode=0o700)
    for key in (own / "host_key", ours / "id_ed25519"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    shutil.copy(ours / "id_ed25519.pub", own / "authorized_keys")
    port = free_port()
    (own / "config").write_text(
        f"ListenAddress 127.0.0.1:{port}\nHostKey {own}/host_key\nAuthorizedKeysFile {own}/authorized_keys\n"
        f"PidFile {own}/pid\nStrictModes no\nUsePAM no\nPasswordAuthentication no\nPermitRootLogin prohibit-password\n"
        "Subsystem sftp internal-sftp\n"
    )
    with (own / "log").open("w") as log:
        server = subprocess.Popen(
            [program, "-D", "-e", "-f", str(own / "config")], stderr=log, stdin=subprocess.DEVNULL
        )
    try:
        _wait_for(port, server, own / "log")
        user = subprocess.run(["id", "-un"], capture_output=True, text=True, check=True).stdout.strip()
        (ours / "config").write_text(f"Host lab-server\n  HostName 127.0.0.1\n  Port {port}\n  User {user}\n")
        yield f"ssh://lab-server{folder}/storage"
    finally:
        server.terminate()
        server.wait()


def _wait_for(port: int, server: subprocess.Popen, log: Path) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and server.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise RuntimeError(f"sshd does not answer: {log.read_text()}")


@contextmanager
def s3(home: Path) -> Iterator[tuple[str, str]]:
    """Start an S3 server with one bucket, put the keys where AWS tools look; yield the bucket's and its own address.

    Skips where the server or DVC's plug-in is not installed.
    """
    pytest.importorskip("dvc_s3", reason="dvc-s3 is not installed (pip install -e '.[remotes]')")
    pytest.importorskip("moto", reason="moto is not installed (pip install -e '.[dev]')")
    import boto3
    from moto.server import ThreadedMotoServer

    (home / ".aws").mkdir()
    (home / ".aws/credentials").write_text(f"[default]\naws_access_key_id = {KEY}\naws_secret_access_key = {SECRET}\n")
    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        endpoint = f"http://{host}:{port}"
        client = boto3.client(
            "s3",
            endpoint_url=endpoint,
            region_name="us-east-1",
            aws_access_key_id=KEY,
            aws_secret_access_key=SECRET,
        )
        client.create_bucket(Bucket="grasps")
        yield "s3://grasps/lab", endpoint
    finally:
        server.stop()
