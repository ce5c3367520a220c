"""Edits the project at random, again and again, and compares every result with a run from nothing.

    python benchmarks/random_edits.py --sequences 2 --edits 12 --seed 1

A clone at scale tiny, with real DVC and real physics, is edited as people do: objects come, change, change places and
go; parameters, words, statements and numbers in the code change and change back; a run is killed; results are lost, the
cache is cleaned, DVC forgets its runs, another branch is looked at, a stage runs by hand. After each edit `dvc repro`
computes what it finds missing. Then all results must have the bytes of a run of the same files in another clone, with
an empty cache and nothing left of any other run.

An edit costs half a CPU minute to two, with the targets that are the default. Exit code 1: something differs, and the
clones stay in `--folder`.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import re
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from kill_soak import ROOT, RUNNING, Clone, Difference, end

SOURCES = ("pipeline", "hands", "data/raw", "dvc.yaml", "params.yaml", "constraints.txt", ".dvcignore")
NO_RESULTS = ("data/raw/", "data/.unfinished/")
COMPUTED = re.compile(
    r"^(\S+): (\d+) of (\d+) \w+ to compute.*?(?:, (\d+) finished by an interrupted run)?$", re.MULTILINE
)
RESTORED = re.compile(r"^Stage '(.+)' is cached", re.MULTILINE)
NUMBER = re.compile(r"^([A-Z][A-Z_]+ = )(\d+\.\d+)(?=$|  #)", re.MULTILINE)
# Rooms whose code the results depend on up to the trials.
ROOMS = ("energy", "evaluate", "hand", "merge", "motion", "pairing", "physics", "prepare", "synthesize", "validate")
MOST_OBJECTS = 2  # in one style, so that an edit costs about a minute
PARAMETERS: dict[str, list[Any]] = {
    "synthesize.pinch.chains": [20, 24, 28],
    "synthesize.side.chains": [44, 48, 52],
    "synthesize.pinch.table_clearance": [0.004, 0.005, 0.006],
    "synthesize.side.keep_out_margin": [0.002, 0.003, 0.004],
    "validate.most_candidates": [12, 14, 16],
    "validate.drift_limit": [0.015, 0.02],
    "physics.object_friction": [0.8, 0.9],
    "merge.most_combinations": [8, 10, 12],
    "merge.grasps_per_pair": [1, 2, 3],
    "pairs": ["all", 1],
    "evaluate.trials": [1, 2, 3],
    "evaluate.perturbation": [0.004, 0.005, 0.006],
    "seed": [1, 2],
}


def cpu_seconds() -> float:
    """Return what all ended child processes used."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def fingerprints(root: Path) -> dict[str, str]:
    """Return path -> SHA-256 of all results."""
    found = {}
    for path in sorted([*(root / "data").rglob("*"), *(root / "models").rglob("*"), root / "code.yaml"]):
        name = path.relative_to(root).as_posix()
        if path.is_file() and not name.startswith(NO_RESULTS) and path.name != ".gitignore":
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


class Project:
    """The clone that is edited, and the one that always begins from nothing."""

    def __init__(self, folder: Path, targets: list[str], draw: random.Random) -> None:
        self.clone, self.nothing = Clone(folder / "edited"), Clone(folder / "nothing")
        self.targets, self.draw = targets, draw
        self.root, self.log = self.clone.root, folder / "edited.log"
        self.references: dict[str, dict[str, str] | None] = {}
        self.results: list[str] = []  # commits
        self.made = 0
        self.seconds = 60.0  # that a run takes, for the moment of a kill

    def git(self, *arguments: str) -> str:
        """Run git in the edited clone and return what it prints."""
        command = ["git", "-c", "user.name=Random", "-c", "user.email=random@localhost", *arguments]
        return subprocess.run(command, cwd=self.root, check=True, capture_output=True, text=True).stdout

    def commit(self, message: str) -> None:
        """Commit everything that is not ignored."""
        self.git("add", "--all")
        self.git("commit", "--quiet", "--allow-empty", "--message", message)

    def dvc(self, *arguments: str) -> None:
        """Run dvc in the edited clone."""
        command = [sys.executable, "-m", "dvc", *arguments]
        done = subprocess.run(command, cwd=self.root, env=self.clone.environment, capture_output=True, text=True)
        if done.returncode:
            raise Difference(f"{' '.join(command[2:])} failed: {done.stderr}")

    def repro(self, clone: Clone, log: Path, killed_after: float = 0.0) -> tuple[int, str]:
        """Bring the targets up to date, or kill the run; return its exit code and what it printed."""
        begin, start = log.stat().st_size if log.exists() else 0, time.monotonic()
        process = clone.repro(log, *self.targets)
        try:
            process.wait(killed_after or None)
        except subprocess.TimeoutExpired:
            pass
        finally:
            end(process.pid)
            process.wait()
        if not killed_after:
            self.seconds = max(10.0, time.monotonic() - start)
        return process.returncode, log.read_bytes()[begin:].decode(errors="replace")

    def tree(self) -> str:
        """Return what names the present sources and parameters, as committed."""
        return self.git("rev-parse", *(f"HEAD:{name}" for name in SOURCES))

    def from_nothing(self) -> dict[str, str] | None:
        """Return the results of the present sources where nothing was made before; None: they are refused."""
        tree = self.tree()
        if tree not in self.references:
            root, log = self.nothing.root, self.nothing.root.with_suffix(".log")
            shutil.rmtree(root, ignore_errors=True)
            log.unlink(missing_ok=True)
            clone = ["git", "-c", "advice.detachedHead=false", "clone", "--quiet", str(self.root), str(root)]
            subprocess.run(clone, check=True)
            for name in ("dvc.lock", "code.yaml"):
                (root / name).unlink(missing_ok=True)
            code, _ = self.repro(self.nothing, log)
            self.references[tree] = None if code else fingerprints(root)
        return self.references[tree]

    # --- edits: each returns what it did

    def parameters(self) -> dict[str, Any]:
        """Return params.yaml."""
        return yaml.safe_load((self.root / "params.yaml").read_text())

    def write(self, content: dict[str, Any]) -> None:
        """Replace params.yaml."""
        (self.root / "params.yaml").write_text(yaml.safe_dump(content, sort_keys=False))

    def own_objects(self) -> list[str]:
        """Return the objects that came by an edit."""
        content = self.parameters()
        return [name for name in [*content["objects"], *content["meshes"]] if name.startswith("thing_")]

    def add_object(self) -> str:
        """Name one more object, by a recipe or a file, at any place of a style."""
        content = self.parameters()
        free = [style for style, names in content["styles"].items() if len(names) < MOST_OBJECTS]
        if not free:
            return self.remove_object()
        style, name = self.draw.choice(free), f"thing_{self.made}"
        self.made += 1
        width = round(self.draw.uniform(0.04, 0.055), 3)
        height = round(self.draw.uniform(0.045, 0.1), 3)
        if self.draw.random() < 0.5:
            recipe = self.draw.choice(["box", "cylinder"])
            content["objects"][name] = {"recipe": recipe, "extents": [width, width, height], "up": "+z"}
        else:
            import trimesh

            recipe = "file"
            trimesh.creation.box((width, width, height)).export(self.root / f"data/raw/{name}.stl")
            content["meshes"][name] = {"file": f"data/raw/{name}.stl", "unit": "m"}
        names = content["styles"][style]
        names.insert(self.draw.randint(0, len(names)), name)
        self.write(content)
        return f"add {name} ({recipe}, {style})"

    def remove_object(self) -> str:
        """Take an object away that an edit brought."""
        if not self.own_objects():
            return self.add_object()
        name, content = self.draw.choice(self.own_objects()), self.parameters()
        for section in (content["objects"], content["meshes"]):
            section.pop(name, None)
        for names in content["styles"].values():
            names[:] = [other for other in names if other != name]
        self.write(content)
        return f"remove {name}"

    def change_object(self) -> str:
        """Change mass or size of one object."""
        content = self.parameters()
        shapes = {**content["objects"], **content["meshes"]}
        name = self.draw.choice(sorted(shapes))
        what = self.draw.choice(["density", "scale"])
        values = [400.0, 500.0, 600.0] if what == "density" else [0.98, 1.0, 1.02]
        shapes[name][what] = self.draw.choice([value for value in values if value != shapes[name].get(what)])
        self.write(content)
        return f"{what} of {name} = {shapes[name][what]}"

    def reorder(self) -> str:
        """Give objects other places in their styles."""
        content = self.parameters()
        for names in content["styles"].values():
            self.draw.shuffle(names)
        self.write(content)
        return f"order {content['styles']}"

    def change_parameter(self) -> str:
        """Change one parameter."""
        content = self.parameters()
        path = self.draw.choice(sorted(PARAMETERS))
        *parents, last = path.split(".")
        section = content
        for parent in parents:
            section = section[parent]
        section[last] = self.draw.choice([value for value in PARAMETERS[path] if value != section[last]])
        self.write(content)
        return f"{path} = {section[last]}"

    def _module(self) -> Path:
        files = [path for room in ROOMS for path in sorted((self.root / "pipeline" / room).glob("*.py"))]
        return self.draw.choice(files)

    def change_words(self) -> str:
        """Change a comment and a docstring."""
        file = self._module()
        file.write_text(file.read_text().replace('"""', '"""Now: ', 1) + f"# remark {self.draw.randrange(1000)}\n")
        return f"words in {file.relative_to(self.root)}"

    def change_statement(self) -> str:
        """Add a statement that changes no result."""
        file = self._module()
        file.write_text(file.read_text() + f"\n_NUMBER_{self.draw.randrange(1000)} = 1\n")
        return f"a statement in {file.relative_to(self.root)}"

    def change_number(self) -> str:
        """Change a constant of the code by one in a hundred."""
        files = [path for room in ROOMS for path in sorted((self.root / "pipeline" / room).glob("*.py"))]
        places = [(file, match) for file in files for match in NUMBER.finditer(file.read_text())]
        file, match = self.draw.choice(places)
        text, value = file.read_text(), repr(float(match[2]) * 1.01)
        file.write_text(text[: match.start(2)] + value + text[match.end(2) :])
        return f"{match[1]}{value} in {file.relative_to(self.root)}"

    def restore_code(self) -> str:
        """Take all code back to what it was in the beginning."""
        if not self.git("diff", "--name-only", "begin", "--", "pipeline"):
            return self.change_number()
        self.git("checkout", "--quiet", "begin", "--", "pipeline")
        return "the code as in the beginning"

    def change_branch(self) -> str:
        """Go to an earlier result, with or without `dvc checkout`."""
        others = [commit for commit in self.results[:-1] if self.git("diff", "--name-only", commit, "--", *SOURCES)]
        if not others:
            return self.add_object()
        self.git("checkout", "--quiet", "--detach", self.draw.choice(others))
        with_data = self.draw.random() < 0.5
        if with_data:
            self.dvc("checkout", "--force", "--allow-missing")
        return f"branch at {self.git('log', '-1', '--format=%s').strip()!r}" + ", dvc checkout" * with_data

    def clean_cache(self) -> str:
        """Remove from the cache what the workspace does not use."""
        self.dvc("gc", "--workspace", "--force")
        return f"dvc gc; {self.change_object()}"

    def forget_runs(self) -> str:
        """Remove DVC's record of earlier runs."""
        shutil.rmtree(self.root / ".dvc/cache/runs", ignore_errors=True)
        return f"no record of runs; {self.any_small_edit()}"

    def lose_results(self) -> str:
        """Remove a folder of results."""
        folders = [path for path in sorted((self.root / "data").glob("*/*")) if path.parent.name != "raw"]
        lost = self.draw.choice(folders) if folders else self.root / "data/merge"
        if lost.is_dir():
            shutil.rmtree(lost)
        else:
            lost.unlink(missing_ok=True)
        return f"lose {lost.relative_to(self.root)}"

    def run_by_hand(self) -> str:
        """Change a parameter, and test the candidates of one object by hand."""
        edit, content = self.change_parameter(), self.parameters()
        style = self.draw.choice(["pinch", "side"])
        name = self.draw.choice(content["styles"][style])
        command = ["-m", "pipeline.validate", "--style", style, "--object", name]
        done = subprocess.run(
            [sys.executable, *command], cwd=self.root, env=self.clone.environment, capture_output=True, text=True
        )
        return f"{edit}; validate {style} {name} by hand ({'done' if done.returncode == 0 else 'refused'})"

    def any_small_edit(self) -> str:
        """Do one of the edits of files."""
        edits = [self.add_object, self.remove_object, self.change_object, self.change_parameter, self.change_number]
        return self.draw.choice(edits)()

    def kill(self) -> str:
        """Edit, begin to compute, and kill everything; then go on, edit once more, or take the edit back."""
        edit = self.any_small_edit()
        self.commit(f"Killed: {edit}")
        after = self.draw.uniform(0, self.seconds)
        _, printed = self.repro(self.clone, self.log, killed_after=after)
        stage = (RUNNING.findall(printed) or ["its beginning"])[-1]
        text = f"{edit}; killed after {after:.0f} s in {stage}"
        then = self.draw.choice(["go on", "edit", "back"])
        if then == "edit":
            return f"{text}; {self.any_small_edit()}"
        if then == "back":
            self.git("checkout", "--quiet", "HEAD~1", "--", *SOURCES)
            return f"{text}; taken back"
        return text


def edit_once(project: Project, edit: Callable[[], str], label: str) -> list[str]:
    """Do one edit, compute, compare, and print a line; return the differences."""
    before = cpu_seconds()
    done = edit()
    print(f"{label}  {done}", flush=True)
    project.commit(f"Edit {done}")
    code, printed = project.repro(project.clone, project.log)
    own = cpu_seconds() - before
    counts = {
        stage: f"{stage} {number}/{everything}" + (f" ({late} finished)" if late else "")
        for stage, number, everything, late in COMPUTED.findall(printed)
    }
    ran = ", ".join(counts.get(stage, stage) for stage in RUNNING.findall(printed)) or "nothing"
    restored = len(RESTORED.findall(printed))
    expected = project.from_nothing()
    nothing = cpu_seconds() - before - own
    found = fingerprints(project.root)
    if code or expected is None:
        texts = [] if code and expected is None else [f"only one of both is refused:\n{printed[-2000:]}"]
        verdict = "refused, as from nothing"
        project.git("checkout", "--quiet", "HEAD~1", "--", *SOURCES)
    else:
        texts = [f"{name} is missing" for name in expected.keys() - found.keys()]
        texts += [f"{name} is left over" for name in found.keys() - expected.keys()]
        texts += [f"{name} differs" for name in sorted(expected) if found.get(name, expected[name]) != expected[name]]
        verdict = f"{len(expected)} files as from nothing"
    project.commit(f"Results of {done}")
    project.results.append(project.git("rev-parse", "HEAD").strip())
    print(f"      ran {ran}; {restored} restored by DVC; {own:.0f} CPU s, from nothing {nothing:.0f} CPU s")
    print(f"      {'; '.join(sorted(texts)) if texts else verdict}", flush=True)
    return texts


def sequence(project: Project, edits: int, label: str) -> int:
    """Do a sequence of edits and return how many of them ended in differences."""
    draw, wrong = project.draw, 0
    weighted: list[tuple[Callable[[], str], int]] = [
        (project.add_object, 3),
        (project.remove_object, 2),
        (project.change_object, 2),
        (project.reorder, 1),
        (project.change_parameter, 4),
        (project.change_words, 1),
        (project.change_statement, 2),
        (project.change_number, 2),
        (project.restore_code, 2),
        (project.change_branch, 3),
        (project.clean_cache, 1),
        (project.forget_runs, 1),
        (project.lose_results, 1),
        (project.run_by_hand, 2),
        (project.kill, 4),
    ]
    for number in range(edits):
        (edit,) = draw.choices([edit for edit, _ in weighted], [weight for _, weight in weighted])
        wrong += bool(edit_once(project, edit, f"{label} {number + 1:3d}"))
    return wrong


def begin(project: Project, source: Path) -> None:
    """Clone, and compute for the first time."""
    shutil.rmtree(project.root, ignore_errors=True)
    project.clone.make("tiny", source)
    project.commit("Begin")
    project.git("tag", "--force", "begin")
    before = cpu_seconds()
    code, printed = project.repro(project.clone, project.log)
    if code:
        raise Difference(f"the first run failed:\n{printed[-2000:]}")
    project.commit("Results of the beginning")
    project.results.append(project.git("rev-parse", "HEAD").strip())
    project.references[project.tree()] = fingerprints(project.root)  # nothing was made before
    print(f"begin: {len(RUNNING.findall(printed))} stages, {cpu_seconds() - before:.0f} CPU s", flush=True)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sequences", type=int, default=1, help="each with a clone of its own (1)")
    parser.add_argument("--edits", type=int, default=12, help="in each sequence (12)")
    parser.add_argument("--seed", type=int, default=1, help="of the edits (1)")
    parser.add_argument("--targets", nargs="*", default=["evaluate@synthesized"], help="stages (evaluate@synthesized)")
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "random-edits", help="for the clones and the log")
    parser.add_argument("--keep", action="store_true", help="leave the folder when all is well")
    arguments = parser.parse_args()
    folder: Path = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    wrong = 0
    references: dict[str, dict[str, str] | None] = {}
    try:
        for number in range(arguments.sequences):
            project = Project(folder, arguments.targets, random.Random(f"{arguments.seed} {number}"))
            project.references = references
            begin(project, ROOT)
            wrong += sequence(project, arguments.edits, f"{number + 1}")
    except Difference as error:
        print(f"FAILED: {error}")
        return 1
    print(f"{arguments.sequences * arguments.edits} edits, {wrong} of them with differences; {cpu_seconds():.0f} CPU s")
    if not wrong and not arguments.keep:
        shutil.rmtree(folder)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
