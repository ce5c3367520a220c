"""A stand-in for `python` in working copies: processes that have the large packages loaded when they begin.

Loading them takes longer than most stages at scale tiny. A server loads them once and forks; the stand-in, a script of
the name `python`, hands its arguments, folder, environment and files over, and ends as the forked process does. When it
is killed, so is that process with all that it started. The project's own modules are loaded anew, from the folder.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
import traceback
import warnings
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LARGE = (
    *("pipeline", "numpy", "pandas", "pyarrow.parquet", "scipy.spatial", "torch", "warp", "trimesh", "sapien", "coal"),
    *("mujoco", "pinocchio", "pydantic", "pycolmap", "mlflow", "dvc.cli.parser", "dvc.repo", "dvc.commands.repro"),
)
OWN = ("pipeline", "tools", "tests", "hydra_plugins", "seqgrasp")
STAND_IN = """#!{real} -SE
import json, os, socket, sys
command = sys.argv[1:]
if not command or command[0] != "-m" and not command[0].endswith(".py"):
    os.execv("{real}", ["{real}", *command])
with socket.socket(socket.AF_UNIX) as server:
    server.connect("/proc/self/fd/%d/server" % os.open("{folder}", os.O_RDONLY))  # short, as such addresses must be
    asked = json.dumps([command, os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(server, [len(asked).to_bytes(8, "little")], [0, 1, 2])
    server.sendall(asked)
    answer = server.recv(1)
os._exit(answer[0] if answer else 1)
"""


def start(folder: Path) -> subprocess.Popen[str]:
    """Start the server and write the stand-in into a folder; the server ends when its stdin is closed."""
    program = folder / "python"
    program.write_text(STAND_IN.format(real=sys.executable, folder=folder))
    program.chmod(0o755)
    server = subprocess.Popen(
        [sys.executable, str(Path(__file__))],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert server.stdout and server.stdout.readline() == "ready\n"
    return server


def serve() -> list[str]:
    """Fork for every stand-in that connects; return its command in the process that is to run it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in LARGE:
            import_module(name)
    gc.freeze()  # forked processes need not copy what they only look at
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("server")
        listener.listen()
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those that `keep` ends
        print("ready", flush=True)
        while listener in select.select([listener, sys.stdin], [], [])[0]:
            connection, _ = listener.accept()
            if os.fork() == 0:
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                return keep(connection)
            connection.close()
    os._exit(0)


def keep(connection: socket.socket) -> list[str]:
    """Fork once more, and tell the stand-in how that process ended; return the command in that process alone."""
    head, files, *_ = socket.recv_fds(connection, 8, 3)
    with connection.makefile("rb") as stream:
        command, folder, environment = json.loads(stream.read(int.from_bytes(head, "little")))
    child = os.fork()
    if child == 0:
        connection.close()
        os.setsid()
        for number, file in enumerate(files):
            os.dup2(file, number)
            os.close(file)
        become(command, folder, environment)
        return command
    for file in files:
        os.close(file)
    ended = os.pidfd_open(child)
    if ended not in select.select([ended, connection], [], [])[0]:
        os.killpg(child, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    try:
        connection.send(bytes([code % 256]))
    finally:
        os._exit(0)


def become(command: list[str], folder: str, environment: dict[str, str]) -> None:
    """Give this process the folder, the variables and the arguments of the command, and none of our modules."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for name in [name for name in sys.modules if name.split(".")[0] in OWN]:
        del sys.modules[name]
    own = folder if command[0] == "-m" else str(Path(command[0]).resolve().parent)
    named = environment.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[:] = [own, *filter(None, named), *(path for path in sys.path[1:] if path != str(ROOT))]
    sys.argv = command[command[0] == "-m" :]


def end(code: object) -> None:
    """End as Python does with this argument of ``sys.exit``, without taking thousands of modules apart."""
    if isinstance(code, str):
        print(code, file=sys.stderr)
    threading._shutdown()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code if isinstance(code, int) else int(code is not None))


if __name__ == "__main__":
    first, *others = serve()
    try:
        if first == "-m":
            runpy.run_module(others[0], run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(first, run_name="__main__")
        end(0)
    except SystemExit as error:
        end(error.code)
    except BaseException:
        traceback.print_exc()
        end(1)
