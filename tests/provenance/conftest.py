"""A small repository with a command, shared rooms, data, pins and parameters."""

from pathlib import Path

import pytest

FILES = {
    "pipeline/__init__.py": "",
    "pipeline/grow/__init__.py": '"""Growing."""\n',
    "pipeline/grow/__main__.py": """
        from __future__ import annotations
        from typing import TYPE_CHECKING
        from pipeline.records.parameters import load_parameters
        if TYPE_CHECKING:
            import torch
            from pipeline.others import Thing

        def sections(item: str) -> list[str]:
            \"\"\"shrink\"\"\"
            return ["seed", f"grow.{item}"]

        def grow(thing: Thing) -> int:
            \"\"\"Grow.\"\"\"
            from pipeline.shared import sums  # late
            return sums.total(load_parameters(["grow"]))
        """,
    "pipeline/shared/__init__.py": "",
    "pipeline/shared/sums.py": """
        import json
        import yaml
        from .rounding import half

        def total(values):
            return half(sum(values))
        """,
    "pipeline/shared/rounding.py": "def half(value):\n    import numpy as np\n    return np.float64(value / 2)\n",
    "pipeline/shared/palette.css": "a { color: red }\n",
    "pipeline/shared/deeper/table.txt": "1 2 3\n",
    "pipeline/others/__init__.py": "import trimesh\n\nclass Thing:\n    pass\n",
    "pipeline/others/picture.svg": "<svg/>\n",
    "pipeline/records/__init__.py": "",
    "pipeline/records/parameters/__init__.py": """
        from pydantic import Field, model_validator
        from pipeline.records.parameters.grow import GrowParameters
        from pipeline.records.parameters.shrink import ShrinkParameters, smallest
        from pipeline.records.parameters.section import Section

        LIMIT = 3

        class Parameters(Section):
            seed: int = Field(description="Seed.")
            grow: GrowParameters
            validate_: ShrinkParameters = Field(alias="shrink")

            @model_validator(mode="after")
            def _agree(self):
                if self.seed > LIMIT or smallest(self.grow):
                    raise ValueError("no")
                return self

            def both(self):
                return self.grow, self.validate_

        def load_parameters(names):
            return {name: getattr(Parameters(), name) for name in names}
        """,
    "pipeline/records/parameters/section.py": "class Section:\n    pass\n",
    "pipeline/records/parameters/grow.py": """
        from pydantic import Field
        from pipeline.records.parameters.section import Section

        class GrowParameters(Section):
            rate: float = Field(0.5, gt=0, description="How fast.")
        """,
    "pipeline/records/parameters/shrink.py": """
        from pipeline.records.parameters.section import Section

        class ShrinkParameters(Section):
            pass

        def smallest(grow):
            return grow.rate < 0.1
        """,
    "dvc.yaml": """
        stages:
          code:
            cmd: python -m pipeline.code
          grow:
            foreach: [a, b]
            do:
              cmd: python -m pipeline.grow --item ${item}
              params: ["items.${item}", grow, {code.yaml: [grow]}]
          elsewhere:
            cmd: ./build
        """,
    "params.yaml": "seed: 1\nitems: {a: 1, b: 2}\ngrow: {rate: 0.5}\nshrink: {}\ncompute: {workers: 2}\n",
    "constraints.txt": "# pins\nnumpy==2.0\nPyYAML==6.0\npydantic==2.1\ntrimesh==4.0\ntorch==2.6\n",
    "pipeline/code/__init__.py": "",
    "pipeline/code/__main__.py": "",
}


class Repository:
    """A folder with the files; `edit` changes one."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for name, text in FILES.items():
            self.write(name, text)

    def write(self, name: str, text: str) -> None:
        lines = text.splitlines()
        indent = min((len(line) - len(line.lstrip()) for line in lines if line.strip()), default=0)
        file = self.root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("\n".join(line[indent:] for line in lines) + "\n")

    def edit(self, name: str, old: str, new: str) -> None:
        text = (self.root / name).read_text()
        assert text.count(old) == 1, (name, old)
        (self.root / name).write_text(text.replace(old, new))


@pytest.fixture
def repository(tmp_path) -> Repository:
    return Repository(tmp_path)
