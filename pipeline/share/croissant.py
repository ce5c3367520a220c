"""The description of a published folder for programs: Croissant 1.1, as JSON-LD."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pyarrow as pa

from pipeline.share.columns import GRASP_COLUMNS
from pipeline.share.publication import TABLE, Split

CONFORMS = "http://mlcommons.org/croissant/1.1"
_CR, _SC = "http://mlcommons.org/croissant/", "https://schema.org/"
# The context that the format prescribes.
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": _SC,
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": _CR,
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataBiases": "cr:dataBiases",
    "dataCollection": "cr:dataCollection",
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "arrayShape": "cr:arrayShape",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "personalSensitiveInformation": "cr:personalSensitiveInformation",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": _SC,
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}


def croissant(
    name: str, text: str, licence: str, url: str, version: str, date: str, splits: Sequence[Split]
) -> dict[str, Any]:
    """Return the content of ``croissant.json``.

    Args:
        text: what the data set is, in a paragraph.
        licence: its SPDX identifier.
        url: where the data set is found.
        date: of publication, such as 2026-11-30.
    """
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS,
        "name": name,
        "description": text,
        "license": f"https://spdx.org/licenses/{licence}",
        "url": url,
        "version": version,
        "creator": {"@type": "sc:Organization", "name": "Sequential grasping"},
        "datePublished": date,
        "citeAs": f"{name} {version}, made by the method of SeqMultiGrasp (IROS 2025)",
        "distribution": [_file(split) for split in splits],
        "recordSet": [_records(split) for split in splits],
    }


def _file(split: Split) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": f"{split.source}-{split.name}.parquet",
        "name": f"{split.source}-{split.name}.parquet",
        "contentUrl": split.path,
        "contentSize": f"{split.size} B",
        "encodingFormat": "application/x-parquet",
        "sha256": split.sha256,
    }


def _records(split: Split) -> dict[str, Any]:
    name = f"{split.source}_{split.name}"
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": f"{split.rows} {split.source} grasps, split {split.name}.",
        "field": [_field(name, column, split) for column in TABLE],
    }


def _field(records: str, column: pa.Field, split: Split) -> dict[str, Any]:
    kind, shape = column.type, ""
    if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        shape = str(kind.list_size) if pa.types.is_fixed_size_list(kind) else "-1"
        kind = kind.value_type
    found: dict[str, Any] = {
        "@type": "cr:Field",
        "@id": f"{records}/{column.name}",
        "name": column.name,
        "description": GRASP_COLUMNS[column.name],
        "dataType": _data_type(kind),
        "source": {
            "fileObject": {"@id": f"{split.source}-{split.name}.parquet"},
            "extract": {"column": column.name},
        },
    }
    return found | ({"isArray": True, "arrayShape": shape} if shape else {})


def _data_type(kind: pa.DataType) -> str:
    if pa.types.is_floating(kind):
        return f"cr:Float{kind.bit_width}"
    if pa.types.is_integer(kind):
        return f"cr:Int{kind.bit_width}"
    return "sc:Boolean" if pa.types.is_boolean(kind) else "sc:Text"
