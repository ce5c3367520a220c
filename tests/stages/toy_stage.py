"""A stage of items for the tests: squares numbers of ``params.yaml`` into ``out``; notes which it computed in ``log``.

An item named in the environment variable ``KILL`` ends the process that computes it; those in ``FAIL`` raise an error.
"""

import os
import signal
from pathlib import Path

import pandas as pd
import pyarrow as pa
import yaml

from pipeline.compute.pool import Calls
from pipeline.records.digests import digest
from pipeline.records.errors import UserError
from pipeline.stages.items import Stage, make_items
from pipeline.stages.outputs import Folders, Tables
from pipeline.stages.running import run_stage

SCHEMA = pa.schema([("name", pa.string()), ("part", pa.int32()), ("square", pa.list_(pa.float64()))])


def square(key_and_value):
    key, value = key_and_value
    with open(os.environ["LOG"], "a") as log:
        log.write(f"{key}\n")
    if os.environ.get("KILL") == key:
        os.kill(os.getpid(), signal.SIGKILL)
    if key in os.environ.get("FAIL", "").split():
        raise ValueError(f"{value} cannot be squared")
    if key in os.environ.get("REFUSE", "").split():
        raise UserError(f"{key}: {value} is no number that can be squared; give another.")
    return value * value


def main():
    parameters = yaml.safe_load(Path("params.yaml").read_text())
    values = {f"{name}/{part}": value for name, parts in parameters["numbers"].items() for part, value in parts.items()}
    tables, folders = Tables(Path("out"), SCHEMA, ("part",)), Folders(Path("out"))
    output = tables if parameters["kind"] == "tables" else folders

    def work(key, keep):
        (result,) = yield Calls(square, [(key, values[key])])
        name, part = key.split("/")
        # Some items have several rows, some none.
        row = {"name": name, "part": int(part), "square": [result, None] if result % 2 else None}
        frame = pd.DataFrame([row] * (values[key] % 3), columns=SCHEMA.names)
        keep(key, tables.rows(frame) if output is tables else {"a/square.txt": str(result).encode(), "b": b""})

    fingerprints = {key: digest(parameters["code"], key, value) for key, value in values.items()}
    make_items(
        Stage("squares", "numbers", output),
        fingerprints,
        lambda keys, keep: [(key, lambda key=key: work(key, keep)) for key in keys],
        workers=1,
    )


if __name__ == "__main__":
    raise SystemExit(run_stage("squares", main))
