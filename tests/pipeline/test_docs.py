"""The README and the pages in docs/: their commands, options, paths, parameters, snippets and links exist."""

import ast
import re
import shlex
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

import seqgrasp
from pipeline.records.parameters import Parameters
from tests.pipeline.declared import declared_stages
from tools.add_object import STYLES, command_line
from tools.scales import choices, flatten

ROOT = Path(__file__).resolve().parents[2]
PAGES = (
    "README.md",
    "data/raw/README.md",
    "results/paper/dataset.md",
    *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").glob("*.md")),
)
STAGES = declared_stages(ROOT)
STARTS = ("./dev ", "dvc ", "python ", "git ", "pip ", "dask ", "source ", "cd ")
CODE_FOLDERS = ("benchmarks", "conf", "docs", "examples", "hands", "pipeline", "seqgrasp", "tests", "tools")

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


def lines_of_blocks() -> set[str]:
    """Lines of the blocks that hold commands: those without a language, or in bash."""
    wanted = [text for page in PAGES for language, text in blocks(page) if language in ("", "bash")]
    lines = {line.split("#")[0].strip() for text in wanted for line in text.splitlines() if line.strip()}
    return {re.sub(r"^(\w+=\S+ )+", "", line) for line in lines}  # without variables of the environment


def commands(start: str) -> list[str]:
    inline = {span for page in PAGES for span in spans(page)}
    return sorted(line for line in lines_of_blocks() | inline if line.startswith(start))


def files_in_git() -> set[str]:
    """All files and folders that git has or would take."""
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    files = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    return {str(folder) for name in files for folder in (Path(name), *Path(name).parents)}


def test_there_are_commands_to_check():
    assert {"./dev repro", "./dev test"} <= set(commands("./dev ")) and commands("dvc ") and commands("python ")


def test_no_other_command_is_left_unchecked():
    assert [line for line in lines_of_blocks() if not line.startswith(STARTS)] == []


@pytest.mark.parametrize("command", [c for c in commands("./dev add-object ") if "FILE" not in c])
def test_every_addition_is_understood(command):
    assert command_line().parse_args(shlex.split(command)[2:]).style in STYLES


@pytest.mark.parametrize("group", ["scale", "preset", "hand"])
def test_every_named_choice_exists(group, monkeypatch):
    monkeypatch.chdir(ROOT)
    named = {name for command in commands("./dev ") for name in re.findall(rf"--{group}[ =]([a-z]\w*)", command)}
    assert named and named <= set(choices(group))


@pytest.mark.parametrize("command", commands("python "))
def test_every_python_command_and_its_options_exist(command):
    _, first, *rest = shlex.split(command)
    if first == "-m":
        spec = find_spec(rest[0])
        assert spec and spec.origin
        sources = sorted(Path(spec.origin).parent.glob("*.py"))
        assert not spec.submodule_search_locations or find_spec(f"{rest[0]}.__main__")
    else:
        sources = [ROOT / first]
    text = "".join(source.read_text() for source in sources)
    options = {word.partition("=")[0] for word in rest[first == "-m" :] if re.match(r"--\w", word)}
    assert [option for option in options - {"--help"} if f'"{option}"' not in text] == []


@pytest.mark.parametrize("command", commands("dvc "))
def test_every_dvc_command_is_understood(command):
    from dvc.cli.parser import get_main_parser

    words = shlex.split(command)[1:]
    if len(words) == 1:  # in a sentence, only its name may stand
        words.append("--help")
    try:
        get_main_parser().parse_args(words)
    except SystemExit as end:
        assert end.code == 0
    if command.startswith("dvc repro "):
        named = {word for word in command.split()[2:] if not word.startswith("-")}
        assert named <= {stage.name for stage in STAGES} | {stage.name.partition("@")[0] for stage in STAGES}


@each_page
def test_every_path_of_the_repository_exists(page):
    paths = [span.rstrip("/") for span in spans(page) if re.fullmatch(r"[\w./-]+/[\w./-]*", span)]
    known = files_in_git()
    assert [path for path in paths if path.split("/")[0] in CODE_FOLDERS and path not in known] == []


# These two name figures of the summary and of MLflow like parameters; tests/report/test_summary.py holds the former.
@pytest.mark.parametrize("page", sorted({*PAGES} - {"docs/metrics.md", "docs/comparing.md"}))
def test_every_parameter_exists(page):
    """Dotted names that begin with a section of params.yaml."""
    content = yaml.safe_load(text_of("params.yaml"))
    leaves = [name.split(".") for name in flatten(content)]
    known = {".".join(parts[:length]) for parts in leaves for length in range(1, len(parts) + 1)}
    named = [span for span in spans(page) if re.fullmatch(r"[a-z_]+(\.\w+)+", span) and not span.endswith(".yaml")]
    free = ("meshes.", "objects.")  # members are named by whoever writes them
    assert [
        span for span in named if span.split(".")[0] in content and span not in known and not span.startswith(free)
    ] == []


def overlaid(content, change):
    """Parameters with what a snippet says in the place of theirs."""
    if not (isinstance(content, dict) and isinstance(change, dict)):
        return change
    return content | {name: overlaid(content.get(name), value) for name, value in change.items()}


@each_page
def test_every_snippet_of_parameters_is_valid(page):
    of_captures = ("# tags.yaml", "# scene.yaml")  # tests/reconstruct/test_captures.py reads them
    for language, text in blocks(page):
        if language == "yaml" and not text.startswith(of_captures):
            Parameters.model_validate(overlaid(yaml.safe_load(text_of("params.yaml")), yaml.safe_load(text)))


@each_page
def test_every_snippet_of_python_is_valid_and_names_what_is_public(page):
    for language, text in blocks(page):
        if language == "python":
            ast.parse(text)
    assert set(re.findall(r"\bseqgrasp\.(\w+)", text_of(page))) <= set(seqgrasp.__all__)


def test_the_bobbin_of_the_tutorial_is_one_solid_of_the_size_that_it_names(empty_folder):
    import trimesh

    (source,) = [text for language, text in blocks("docs/tutorial.md") if language == "python"]
    exec(source, {})
    bobbin = trimesh.load("bobbin.stl")
    assert bobbin.is_watertight and bobbin.body_count == 1
    assert bobbin.extents.tolist() == pytest.approx([36, 36, 42], abs=0.2)


def test_pages_know_how_many_stages_there_are():
    assert {int(count) for page in PAGES for count in re.findall(r"(\d+) stages\b", text_of(page))} == {len(STAGES)}


@each_page
def test_every_relative_link_leads_to_a_file_in_git(page):
    links = re.findall(r"\]\(([^)\s]+)\)", text_of(page))
    known = files_in_git()
    inside = [link.split("#")[0] for link in links if not re.match(r"https?://|#", link)]
    found = {link: (ROOT / page).parent.joinpath(link).resolve().relative_to(ROOT) for link in inside}
    assert [link for link, path in found.items() if str(path) not in known] == []
