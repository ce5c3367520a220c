import numpy as np
import pytest
import trimesh

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.objects import write_mesh
from pipeline.records.writing import write_json
from pipeline.report.objects import ObjectFacts, read_facts, read_mesh


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / paths.prepared_folder("cube")
    folder.mkdir(parents=True)
    box = trimesh.creation.box((0.04, 0.05, 0.06))
    write_mesh(folder / "mesh.ply", np.asarray(box.vertices), np.asarray(box.faces))
    facts = {"source": "recipe box", "licence": "own work, MIT"}
    write_json(folder / "object.json", {"extents": [0.04, 0.05, 0.06], "mass": 0.06, "provenance": facts})
    return folder


def test_mesh_and_facts_are_read_without_anything_else(folder):
    vertices, faces = read_mesh("cube")
    assert np.ptp(vertices, axis=0) == pytest.approx([0.04, 0.05, 0.06]) and faces.shape == (12, 3)
    assert read_facts("cube") == ObjectFacts("cube", "recipe box", "own work, MIT", [0.04, 0.05, 0.06], 0.06)


@pytest.mark.parametrize(("name", "read"), [("mesh.ply", read_mesh), ("object.json", read_facts)])
def test_missing_and_damaged_files_are_one_sentence(folder, name, read):
    (folder / name).write_text("{}")
    with pytest.raises(UserError, match=f"{name} is damaged .*dvc repro prepare"):
        read("cube")
    (folder / name).unlink()
    with pytest.raises(UserError, match=f"{name} is missing; run `dvc repro prepare"):
        read("cube")
