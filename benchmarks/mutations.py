"""Changes single lines of the code at random, one at a time, and says which changes the tests notice.

    python benchmarks/mutations.py --seed 1 --count 10

Every change is in another room: a comparison turned round, another operator, another number, a condition without its
`not`. In a clone of what is committed, the tests of that room run until the first one fails, or of a room without tests
of its own those of all rooms that import it; the test that failed must pass on the code as it was. A change that
survives shows a test that is missing, or code in which the change makes no difference: read it. Half a minute to some
minutes of one core for each. Exit code 1: fewer were noticed than `--least`.
"""

from __future__ import annotations

import argparse
import ast
import copy
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
OPPOSITES: dict[type, type] = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Change:
    """Another expression in the place of one that stands on one line."""

    file: str
    line: int  # from 1
    begin: int  # columns in bytes
    end: int
    text: str

    def apply(self, root: Path) -> tuple[str, str]:
        """Write the file with the change and return the line before and after."""
        path = root / self.file
        lines = path.read_bytes().splitlines(keepends=True)
        before = lines[self.line - 1]
        lines[self.line - 1] = after = before[: self.begin] + self.text.encode() + before[self.end :]
        path.write_bytes(b"".join(lines))
        return before.decode().strip(), after.decode().strip()


def changed(node: ast.AST) -> ast.AST | None:
    """Return another expression in the place of this one, or None where there is none to choose."""
    new = copy.deepcopy(node)
    match new:
        case ast.Compare(ops=[operator]) if type(operator) in OPPOSITES:
            new.ops = [OPPOSITES[type(operator)]()]
        case (
            ast.BinOp(left=ast.JoinedStr() | ast.Constant(value=str()))
            | ast.BinOp(right=ast.JoinedStr() | ast.Constant(value=str()))
        ):
            return None  # a path or a text: no other operator takes one
        case ast.BinOp(op=operator) | ast.BoolOp(op=operator) if type(operator) in OPPOSITES:
            new.op = OPPOSITES[type(operator)]()
        case ast.UnaryOp(op=ast.Not()):
            return new.operand
        case ast.Constant(value=bool()):
            new.value = not new.value
        case ast.Constant(value=int(number)):
            new.value = number + 1
        case ast.Constant(value=float(number)):
            new.value = number * 1.5 or 1.0
        case _:
            return None
    return new


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield all nodes that do something in functions and modules: no annotations, no texts, no start of a command."""
    if isinstance(node, ast.If) and "__name__" in ast.unparse(node.test):
        return
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr):
                yield child
                yield from statements(child)


def changes_of(room: Path) -> list[Change]:
    """Return every change that could be made in a room."""
    found = []
    for path in sorted(room.rglob("*.py")):
        place = path.relative_to(room.parents[1]).as_posix()
        for node in statements(ast.parse(path.read_bytes())):
            match node:
                case ast.expr(lineno=line, end_lineno=last, col_offset=begin, end_col_offset=int(end)) if line == last:
                    new = changed(node)
                    if new is not None:
                        found.append(Change(place, line, begin, end, f"({ast.unparse(new)})"))
    return found


def tests_of(root: Path, room: str) -> list[str]:
    """Return the folder of the room's own tests, or else the files of tests that name one of its modules."""
    if (root / "tests" / room).is_dir():
        return [f"tests/{room}"]
    name = re.compile(rf"\bpipeline\.{room}\b")
    return [str(file.relative_to(root)) for file in root.glob("tests/*/test_*.py") if name.search(file.read_text())]


def first_failure(root: Path, tests: list[str]) -> str:
    """Run tests, slow ones last, until one fails, and return its name; '' when all pass."""
    for which in ("not slow", "slow"):
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "-p",
            "no:cacheprovider",
            "--color=no",
            "-m",
            which,
            *tests,
        ]
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        named = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
        if named:
            return named[1]
        if done.returncode not in (0, pytest.ExitCode.NO_TESTS_COLLECTED):
            return "the start of the tests"
    return ""


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="of the changes (1)")
    parser.add_argument("--count", type=int, default=10, help="of changes, each in another room (10)")
    parser.add_argument("--least", type=int, help="of them that must be noticed (nine in ten)")
    parser.add_argument("--rooms", nargs="*", help="to draw from (all)")
    parser.add_argument("--list", action="store_true", help="only print the changes")
    arguments = parser.parse_args()
    draw = random.Random(arguments.seed)
    rooms = arguments.rooms or sorted(path.parent.name for path in ROOT.glob("pipeline/*/__init__.py"))
    drawn = draw.sample(rooms, min(arguments.count, len(rooms)))
    noticed = 0
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        root = Path(folder) / "clone"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(root)], check=True)
        for room in drawn:
            change = draw.choice(changes_of(root / "pipeline" / room))
            before, after = change.apply(root)
            print(f"{change.file}:{change.line}\n    - {before}\n    + {after}", flush=True)
            if arguments.list:
                subprocess.run(["git", "checkout", "--quiet", "--", "pipeline"], cwd=root, check=True)
                continue
            begin = time.monotonic()
            failed = first_failure(root, tests_of(root, room))
            subprocess.run(["git", "checkout", "--quiet", "--", "pipeline"], cwd=root, check=True)
            if failed and first_failure(root, [failed.partition("[")[0]]):
                sys.exit(f"{failed} fails without the change as well")
            noticed += bool(failed)
            print(
                f"    {'noticed by ' + failed if failed else 'survived'}, {time.monotonic() - begin:.0f} s", flush=True
            )
    if arguments.list:
        return 0
    print(f"{noticed} of {len(drawn)} noticed")
    return int(noticed < (arguments.least or 0.9 * len(drawn)))


if __name__ == "__main__":
    sys.exit(main())
