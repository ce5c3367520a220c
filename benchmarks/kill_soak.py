"""Kills the pipeline at random moments, runs it again, and compares every byte with a run that nobody disturbed.

    python benchmarks/kill_soak.py --kills 50 --seed 1

Two clones of the repository run the whole pipeline through real DVC, at scale tiny, each with a cache of its own. The
first is left alone and times the stages. The second is killed with SIGKILL: every stage several times, at a moment
drawn uniformly from the time that the stage took; mostly the whole process group (DVC, stage, workers, as in a power
cut), every fifth time one process of the stage alone (as the system does when memory runs out). After each kill
`dvc repro` goes on. At the end both clones must hold the same: dvc.lock, every output, MLflow's record; no temporary
file may be left, and every file in DVC's cache must have the content that its name promises.

Takes about 20 CPU minutes for 50 kills. An interrupted soak goes on with the same command (`--folder` and its log); the
folder is removed when the soak has passed, unless `--keep`. Exit code 1: something differs, or a run failed by itself.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
import yaml

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ("data", "models", "reports", "mlartifacts", "dvc.lock")
UNCOUNTED = {"durations.json", ".durations.lock", ".gitkeep", ".gitignore"}  # durations differ from run to run
RUNNING = re.compile(r"^Running stage '(.+)':", re.MULTILINE)
LARGE = 40e6  # bytes of memory: a Python process that works, rather than a shell or a resource tracker
PATIENCE = 120.0  # s that a run may take to end by itself after one of its processes was killed


class Difference(Exception):
    """What the soak exists to find."""


@dataclass(frozen=True)
class Clone:
    """A clone of the repository with a cache of its own, at scale tiny."""

    root: Path

    @property
    def environment(self) -> dict[str, str]:
        """Return the environment of its commands: nothing leaves the machine, temporary files are seen."""
        temporary = self.root.with_suffix(".tmp")
        temporary.mkdir(exist_ok=True)
        return os.environ | {
            "TMPDIR": str(temporary),
            "PYTHONUNBUFFERED": "1",
            "DVC_NO_ANALYTICS": "1",
            "DVC_SITE_CACHE_DIR": str(self.root.with_suffix(".site")),
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        }

    def make(self, scale: str, source: Path) -> None:
        """Clone what git has committed in ``source``, and compose the parameters; nothing is computed yet."""
        subprocess.run(["git", "clone", "--quiet", str(source), str(self.root)], check=True)
        for name in ("dvc.lock", *(f"reports/{name}" for name in ("dataset.md", "summary.json", "tracking.json"))):
            (self.root / name).unlink(missing_ok=True)
        compose = [sys.executable, "-m", "tools.scales", "compose", scale, "--force"]
        subprocess.run(compose, cwd=self.root, env=self.environment, check=True, stdout=subprocess.DEVNULL)

    def repro(self, log: Path, *arguments: str) -> subprocess.Popen[bytes]:
        """Start what `./dev repro` does in a process group of its own; its output is appended to ``log``."""
        with log.open("ab") as output:
            return subprocess.Popen(
                [
                    "sh",
                    "-c",
                    '"$0" -m tools.prune && exec "$0" -m dvc repro "$@"',
                    sys.executable,
                    *arguments,
                ],
                cwd=self.root,
                env=self.environment | ({"RECOMPUTE": "1"} if "--force" in arguments else {}),
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )


def stage_in(log: Path, begin: int) -> str:
    """Return the stage that DVC began last, reading the log from ``begin`` on; '' before the first."""
    with log.open("rb") as source:
        source.seek(begin)
        found = RUNNING.findall(source.read().decode(errors="replace"))
    return found[-1] if found else ""


def undisturbed(clone: Clone, log: Path) -> dict[str, float]:
    """Run the whole pipeline once and return how long each stage took, in seconds, in their order."""
    process = clone.repro(log)
    begun: dict[str, float] = {}
    while process.poll() is None:
        stage = stage_in(log, 0)
        if stage:
            begun.setdefault(stage, time.monotonic())
        time.sleep(0.05)
    if process.returncode != 0:
        raise Difference(f"the run that nobody disturbed failed by itself; see {log}")
    moments = [*begun.values(), time.monotonic()]
    return {stage: end - begin for stage, begin, end in zip(begun, moments[:-1], moments[1:], strict=True)}


def members(group: int) -> list[psutil.Process]:
    """Return the living processes of a process group."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (ProcessLookupError, psutil.Error):
            continue
    return found


def victim(group: int, generator: random.Random) -> psutil.Process | None:
    """Choose one process of the stage, never DVC itself."""
    large = []
    for process in members(group):
        try:
            if process.pid != group and process.memory_info().rss > LARGE:
                large.append(process)
        except psutil.Error:
            continue
    return generator.choice(sorted(large, key=lambda process: process.pid)) if large else None


def end(group: int) -> None:
    """Kill the whole group and wait until nothing of it is left."""
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        return
    deadline = time.monotonic() + PATIENCE
    while members(group):
        if time.monotonic() > deadline:
            raise Difference(f"processes of the group {group} outlive SIGKILL")
        time.sleep(0.02)


class Soak:
    """The clone that is killed, and how often each of its stages was."""

    def __init__(self, clone: Clone, durations: dict[str, float], folder: Path, generator: random.Random) -> None:
        self.clone, self.durations, self.generator = clone, durations, generator
        self.log, self.kills_file = folder / "soaked.log", folder / "kills.jsonl"
        self.log.touch()
        known = self.kills_file.read_text().splitlines() if self.kills_file.exists() else []
        self.kills = [json.loads(line) for line in known]

    def count(self) -> Counter[str]:
        """Return kills per stage."""
        return Counter(kill["stage"] for kill in self.kills)

    def _record(self, stage: str, who: str, after: float) -> None:
        kill = {"stage": stage, "who": who, "after": round(after, 3), "of": round(self.durations[stage], 3)}
        self.kills.append(kill)
        with self.kills_file.open("a") as target:
            target.write(json.dumps(kill) + "\n")
        print(f"kill {len(self.kills):3d}  {stage:32s} {who:9s} after {after:6.2f} of {kill['of']:.2f} s", flush=True)

    def run(self, wanted: int, *arguments: str) -> bool:
        """Run `dvc repro` until it is killed or has ended; stages that had ``wanted`` kills are left alone.

        Returns:
            Whether it ended well.

        Raises:
            Difference: it failed although nothing was killed, or does not end after one process was.
        """
        start = self.log.stat().st_size
        process = self.clone.repro(self.log, *arguments)
        try:
            return self._watched(process, start, wanted)
        finally:
            end(process.pid)

    def _watched(self, process: subprocess.Popen[bytes], start: int, wanted: int) -> bool:
        stage, begun, due, one_killed = "", 0.0, float("inf"), 0.0
        while process.poll() is None:
            now = time.monotonic()
            if (seen := stage_in(self.log, start)) != stage:
                stage, begun, one_killed = seen, now, 0.0
                left = self.count()[stage] < wanted and stage in self.durations
                due = begun + self.generator.uniform(0, self.durations[stage]) if left else float("inf")
            if now >= due:
                due = float("inf")
                alone = victim(process.pid, self.generator) if len(self.kills) % 5 == 4 else None
                if alone is None:
                    end(process.pid)
                    process.wait()
                    self._record(stage, "all", now - begun)
                    return False
                alone.kill()
                one_killed = now
                self._record(stage, "one", now - begun)
            if one_killed and now > one_killed + self.durations[stage] + PATIENCE:
                raise Difference(f"{stage} goes on for minutes after one of its processes was killed; see {self.log}")
            time.sleep(0.01)
        if process.returncode != 0 and not one_killed:
            raise Difference(f"`dvc repro` failed by itself at {stage or 'its beginning'}; see the end of {self.log}")
        return process.returncode == 0

    def until(self, kills: int) -> None:
        """Kill every stage equally often, ``kills`` times in all, and end with a whole run."""
        each = -(-kills // len(self.durations))
        while not self.run(each):
            pass
        # A stage that was quicker than its draw is run once more, by itself.
        for stage in self.durations:
            while len(self.kills) < kills and self.count()[stage] < each or not self.count()[stage]:
                self.run(each, "--force", "--single-item", stage)
                while not self.run(0, "--no-run-cache"):  # computed again, not taken from DVC's record of runs
                    pass


def files_of(root: Path) -> Iterator[Path]:
    """Yield all results of a clone."""
    for name in RESULTS:
        top = root / name
        yield from (path for path in [top, *top.rglob("*")] if path.is_file() and path.name not in UNCOUNTED)


def fingerprints(root: Path) -> dict[str, str]:
    """Return path -> SHA-256 of all results; MLflow's files are named by content, as their folders are random."""
    found: dict[str, str] = {}
    kept = Counter[str]()
    for path in sorted(files_of(root)):
        name, digest = str(path.relative_to(root)), hashlib.sha256(path.read_bytes()).hexdigest()
        if name.startswith("mlartifacts/"):
            name = f"mlartifacts/{path.name} {digest[:12]}"
            kept[name] += 1
            name = f"{name} #{kept[name]}"
        found[name] = digest
    return found


def recorded(root: Path) -> list[tuple[str, ...]]:
    """Return what MLflow shows: kind, stage, fingerprint, state and status of every run that is not deleted."""
    tags = ("record.kind", "record.key", "dvc.stage", "dvc.stage_fingerprint", "dvc.stage_state")
    with sqlite3.connect(root / "mlflow.db") as database:
        runs = database.execute("select run_uuid, status from runs where lifecycle_stage = 'active'").fetchall()
        values = {(run, key): value for run, key, value in database.execute("select run_uuid, key, value from tags")}
    return sorted((status, *(str(values.get((run, tag), "")) for tag in tags)) for run, status in runs)


def damaged_cache_files(root: Path) -> list[str]:
    """Return files in DVC's cache whose content is not what their name says."""
    cache = root / ".dvc/cache/files/md5"
    return [
        str(path.relative_to(root))
        for path in sorted(cache.rglob("*"))
        if path.is_file()
        if hashlib.md5(path.read_bytes()).hexdigest() != (path.parent.name + path.name).removesuffix(".dir")
    ]


def abandoned(root: Path) -> list[str]:
    """Return temporary files among the results."""
    return sorted(str(path.relative_to(root)) for name in RESULTS for path in (root / name).rglob("*.tmp"))


def differences(reference: Path, soaked: Path) -> list[str]:
    """Return what distinguishes the two clones, in sentences."""
    expected, found = fingerprints(reference), fingerprints(soaked)
    texts = [f"{name} is missing" for name in sorted(expected.keys() - found.keys())]
    texts += [f"{name} is left over" for name in sorted(found.keys() - expected.keys())]
    texts += [f"{name} differs" for name in sorted(expected) if name in found and expected[name] != found[name]]
    texts += [f"{name} is a temporary file" for name in abandoned(soaked)]
    texts += [f"{name} in the cache is damaged" for name in damaged_cache_files(soaked)]
    if recorded(reference) != recorded(soaked):
        texts.append(f"MLflow's record differs: {len(recorded(reference))} runs, {len(recorded(soaked))} after kills")
    for name in ("reference", "soaked"):
        lock = yaml.safe_load((reference.parent / name / "dvc.lock").read_text())
        if not lock or len(lock["stages"]) < 2:
            texts.append(f"dvc.lock of {name} is empty")
    return texts


def table(soak: Soak) -> str:
    """Return the kills per stage as a Markdown table."""
    head = "| stage | took, s | kills | of these, one process | earliest, s | latest, s |"
    lines = [head, "|---|---|---|---|---|---|"]
    for stage, duration in soak.durations.items():
        own = [kill for kill in soak.kills if kill["stage"] == stage]
        after = [kill["after"] for kill in own]
        alone = sum(kill["who"] == "one" for kill in own)
        lines.append(f"| {stage} | {duration:.1f} | {len(own)} | {alone} | {min(after):.1f} | {max(after):.1f} |")
    return "\n".join(lines)


def cpu_minutes() -> float:
    """Return what all ended child processes used."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (usage.ru_utime + usage.ru_stime) / 60


def soaked(arguments: argparse.Namespace) -> list[str]:
    """Do the whole soak and return the differences."""
    folder: Path = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    reference, killed = Clone(folder / "reference"), Clone(folder / "soaked")
    durations_file = folder / "durations.json"
    if not durations_file.exists():
        for path in (reference.root, folder / "reference.log"):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
        reference.make(arguments.scale, ROOT)
        print("running once undisturbed", flush=True)
        durations_file.write_text(json.dumps(undisturbed(reference, folder / "reference.log"), indent=1))
    if not (folder / "kills.jsonl").exists():
        shutil.rmtree(killed.root, ignore_errors=True)
        killed.make(arguments.scale, reference.root)  # the same commit, whatever came since
    durations = json.loads(durations_file.read_text())
    done = len((folder / "kills.jsonl").read_text().splitlines()) if (folder / "kills.jsonl").exists() else 0
    soak = Soak(killed, durations, folder, random.Random(f"{arguments.seed} {done}"))
    soak.until(arguments.kills)
    print("\n" + table(soak))
    print(f"\n{len(soak.kills)} kills; {cpu_minutes():.1f} CPU minutes of processes that ended by themselves")
    left = sum(1 for _ in killed.root.with_suffix(".tmp").iterdir())
    print(f"{left} entries left in the folder for temporary files, outside of the repository")
    return differences(reference.root, killed.root)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50, help="at least so many (50)")
    parser.add_argument("--seed", type=int, default=1, help="of the moments (1)")
    parser.add_argument("--scale", default="tiny", help="a file of conf/scale (tiny)")
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "kill-soak", help="for the clones and the log")
    parser.add_argument("--keep", action="store_true", help="leave the folder when all is well")
    arguments = parser.parse_args()
    arguments.folder = arguments.folder.resolve()
    try:
        texts = soaked(arguments)
    except Difference as error:
        texts = [str(error)]
    for text in texts:
        print(f"FAILED: {text}")
    if not texts:
        print("no difference: every byte is that of the run that nobody disturbed")
        if not arguments.keep:
            shutil.rmtree(arguments.folder)
    return 1 if texts else 0


if __name__ == "__main__":
    sys.exit(main())
