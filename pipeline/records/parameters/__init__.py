"""Typed parameters: the whole of ``params.yaml`` is checked before a stage starts its work.

A stage asks for the sections that it declares in ``dvc.yaml`` and gets nothing else, so that no result can depend on a
parameter that DVC does not know about::

    parameters = load_parameters(["seed", "objects.cube", "synthesize.pinch"])
    parameters["synthesize.pinch"].chains

A parameter that has the same value in all scales has it here, as the default of its field. `conf/` holds only what
differs between scales, hands and presets, and `./dev compose` writes both to ``params.yaml``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError, model_validator

from pipeline.records import paths
from pipeline.records.catalogue import read_catalogue, styles_of_assets
from pipeline.records.errors import UserError, first_mistake
from pipeline.records.hands import description_file
from pipeline.records.parameters.capture import CaptureParameters, ReconstructedParameters, RenderingParameters
from pipeline.records.parameters.compute import ComputeParameters
from pipeline.records.parameters.conditions import ConditionsParameters, under
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.hand import read_description
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.names import require_name
from pipeline.records.parameters.objects import AssetParameters, MeshParameters, ObjectParameters, StylesParameters
from pipeline.records.parameters.pairs import PairsParameter, PartnersWithin, is_tried, sequences
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.picks import PickParameters, check_picks, objects_of
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.records.parameters.reconstruct import ReconstructParameters
from pipeline.records.parameters.report import ReportParameters, TrackParameters
from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.records.parameters.section import Section
from pipeline.records.parameters.synthesize import StyleParameters, SynthesizeParameters
from pipeline.records.parameters.train import TrainParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.texts import parse_yaml

# What the members of a section are, where they are not objects.
_KINDS = {"conditions": "condition", "assets": "source"}
# A stage that reads one of these needs a hand that carries out all picks.
_OF_SEQUENCES = ("merge", "train", "evaluate", "conditions")
OBJECT_NAME = re.compile(r"[a-z][a-z0-9_]*")


class Parameters(Section):
    """The whole of ``params.yaml``."""

    scale: Literal["demo", "paper", "three", "tiny", "wide"] = Field(
        description="Scale: the file of conf/scale that was composed."
    )
    preset: Literal["ours", "official", "published_model"] = Field(
        description="Preset: the file of conf/preset that was composed."
    )
    hand: str = Field(
        description="Hand that grasps: a folder of hands/. Grasping two objects requires the Allegro. Paper: allegro."
    )
    seed: int = Field(1, ge=0, description="Run seed, from which the generator of every item is derived.")
    styles: StylesParameters
    pairs: PairsParameter = Field(
        "all",
        description="Objects that are picked one after the other: `all` pairs every object of styles.pinch with every "
        "object of styles.side; a number gives each first object that many partners, drawn evenly from the seed; "
        "`{partners: 4, within: [ycb]}` draws them among objects of one origin; a list names the pairs as [first, "
        "second]. With more than two picks: `all`, or a list of sequences. Paper: all.",
    )
    picks: tuple[PickParameters, ...] = Field(
        tuple(PickParameters.model_validate({"style": style}) for style in ("pinch", "side")),
        description="The sequence, object by object: how each object is held, and where it stands. Paper: a pinch, "
        "then a grasp with ring finger and palm.",
    )
    objects: dict[str, ObjectParameters] = Field({}, description="Objects from packages and recipes, by name.")
    meshes: dict[str, MeshParameters] = Field({}, description="Objects from the user's own mesh files, by name.")
    assets: dict[str, AssetParameters] = Field(
        {}, description="Packages whose mesh files become objects, by the first part of the objects' names."
    )
    renderings: dict[str, RenderingParameters] = Field({}, description="Captures to render, by name.")
    captures: dict[str, CaptureParameters] = Field({}, description="Captures to reconstruct, by name.")
    reconstructed: dict[str, ReconstructedParameters] = Field(
        {}, description="Pairs whose grasps are sampled from reconstructions, by the object that is picked first."
    )
    prepare: PrepareParameters
    synthesize: SynthesizeParameters
    physics: PhysicsParameters
    validate_: ValidateParameters = Field(alias="validate")
    merge: MergeParameters
    robustness: RobustnessParameters
    train: TrainParameters
    evaluate: EvaluateParameters
    conditions: ConditionsParameters
    reconstruct: ReconstructParameters
    report: ReportParameters
    track: TrackParameters
    compute: ComputeParameters

    @model_validator(mode="after")
    def _names_agree(self) -> Parameters:
        for name in [*self.objects, *self.meshes, *self.assets]:
            if not OBJECT_NAME.fullmatch(name):
                raise ValueError(
                    f"object name {name!r}: use lower-case letters, digits and underscores, and begin with a letter"
                )
        for name in [*self.objects, *self.meshes]:
            if self.is_asset(name):
                raise ValueError(
                    f"the object name {name!r} begins like those of a source under assets; rename the object or the "
                    "source"
                )
        for name, mesh in self.meshes.items():
            if name in self.objects:
                raise ValueError(f"the name {name!r} is used in both objects and meshes; rename one")
            if not _inside(mesh.file, paths.RAW_FOLDER):
                raise ValueError(f"meshes.{name}.file is not below {paths.RAW_FOLDER}; copy the mesh there")
        for style in ("pinch", "side"):
            names = getattr(self.styles, style)
            for name in names:
                if name not in self.objects and name not in self.meshes and not self.is_asset(name):
                    raise ValueError(
                        f"styles.{style} lists the unknown object {name!r}; add it to objects or meshes, or remove it"
                    )
            if len(set(names)) != len(names):
                raise ValueError(f"styles.{style} lists an object twice; remove one")
        return self

    @model_validator(mode="after")
    def _pairs_agree(self) -> Parameters:
        check_picks(self.picks, dict(self.styles))
        if isinstance(self.pairs, int | PartnersWithin) and len(self.picks) > 2:
            raise ValueError("pairs: only partners of two objects are drawn; name the sequences, or write all")
        if isinstance(self.pairs, list):
            known = [objects_of(pick, dict(self.styles)) for pick in self.picks]
            for names in self.pairs:
                if len(names) != len(known):
                    raise ValueError(
                        f"pairs: {', '.join(names)} has {len(names)} objects, but picks has {len(known)}; list as many"
                    )
                for number, (name, own) in enumerate(zip(names, known, strict=True)):
                    if name not in own and not self.is_asset(name):
                        raise ValueError(f"pairs: {name} is not in styles.{self.picks[number].style}; add it there")
            if len(set(self.pairs)) != len(self.pairs):
                raise ValueError("pairs lists a pair twice; remove one")
        for pick in self.picks:
            if pick.post is not None and pick.post.margin < self.evaluate.perturbation:
                raise ValueError("picks: the margin of a post must be at least evaluate.perturbation")
        return self

    @model_validator(mode="after")
    def _sources_agree(self) -> Parameters:
        for source in self.train.data.held_out_sources:
            if source not in self.assets:
                raise ValueError(
                    f"train.data.held_out_sources names {source!r}, which is not under assets; use one of "
                    f"{', '.join(self.assets) or 'none yet'}"
                )
        return self

    @model_validator(mode="after")
    def _hand_agrees(self) -> Parameters:
        try:
            hand = read_description(description_file(self.hand))
        except UserError as error:
            raise ValueError(f"hand: {str(error).removesuffix('.')}") from error
        for number, pick in enumerate(self.picks):
            for finger in pick.fingers or ():
                if finger not in hand.fingers:
                    raise ValueError(
                        f"picks.{number}.fingers: {finger!r} is not a finger of the hand {self.hand}; use "
                        f"{', '.join(hand.fingers)}"
                    )
                described = hand.fingers[finger]
                if number and described.joints and described.straight is None:
                    raise ValueError(
                        f"picks.{number}.fingers: {finger} has no straight posture in which to wait; name it in the "
                        "first pick"
                    )
        for name in ("pinch", "side"):
            style: StyleParameters = getattr(self.synthesize, name)
            where = f"synthesize.{name}"
            if getattr(self.styles, name) and not style.finger_sets:
                raise ValueError(
                    f"styles.{name} lists objects, but {where}.finger_sets is empty; fill it, or empty styles.{name}"
                )
            if style.finger_sets and name not in hand.styles:
                raise ValueError(f"{where}: the hand {self.hand} has no style {name}; set finger_sets to []")
            if not style.finger_sets:
                continue
            named = {"finger_sets": style.finger_sets, "contacts": [key.split("+") for key in style.contacts]}
            for field, sets in named.items():
                for finger in (finger for fingers in sets for finger in fingers):
                    if finger not in hand.fingers:
                        raise ValueError(
                            f"{where}.{field}: {finger!r} is not a finger of the hand {self.hand}; use "
                            f"{', '.join(hand.fingers)}"
                        )
            unknown = [finger for finger, own in hand.fingers.items() if own.joints and own.holding is None]
            if style.keep_out_margin is not None and unknown:
                raise ValueError(
                    f"{where}.keep_out_margin leaves space for fingers that hold another object, and the hand "
                    f"{self.hand} does not say how {unknown[0]} holds one; set it to null, or describe `holding`"
                )
            if hand.mount is None and style.mount_clearance is not None:
                raise ValueError(f"{where}.mount_clearance: the hand {self.hand} has no mount; set it to null")
        return self

    @model_validator(mode="after")
    def _captures_agree(self) -> Parameters:
        for name in [*self.renderings, *self.captures]:
            if not OBJECT_NAME.fullmatch(name):
                raise ValueError(
                    f"capture name {name!r}: use lower-case letters, digits and underscores, and begin with a letter"
                )
        for name, rendering in self.renderings.items():
            for object_name in rendering.objects:
                if object_name not in self.objects and object_name not in self.meshes:
                    raise ValueError(
                        f"renderings.{name}.objects: {object_name!r} is unknown; add it to objects or meshes"
                    )
        rendered = {str(paths.capture_folder(name)) for name in self.renderings}
        for name, capture in self.captures.items():
            if str(Path(capture.folder)) not in rendered and not _inside(capture.folder, paths.RAW_FOLDER):
                raise ValueError(
                    f"captures.{name}.folder is neither the folder of a rendering (data/capture/<name>) nor below "
                    f"{paths.RAW_FOLDER}; copy the photos there"
                )
        for first, item in self.reconstructed.items():
            if item.capture not in self.renderings or item.capture not in self.captures:
                raise ValueError(
                    f"reconstructed.{first}.capture: {item.capture!r} is missing in renderings or captures; add it to "
                    f"both"
                )
            absent = {first, *item.side} - set(self.renderings[item.capture].objects)
            if absent:
                raise ValueError(
                    f"reconstructed.{first}: {min(absent)!r} is not in renderings.{item.capture}.objects; add it there"
                )
        return self

    def check_conditions(self) -> None:
        """Hold `conditions` against the other sections; only what reads them is refused for them.

        Raises:
            ValueError: they do not agree.
        """
        known = set(self.sequences())
        for names in self.conditions.pairs:
            if names not in known:
                raise ValueError(
                    f"conditions.pairs: {', '.join(names)} is not a pair according to styles and pairs; remove it"
                )
        if self.conditions.settings and self.conditions.trials > self.evaluate.trials:
            raise ValueError(f"conditions.trials must not exceed evaluate.trials ({self.evaluate.trials})")
        for name, condition in self.conditions.settings.items():
            where = f"conditions.settings.{name}"
            if not OBJECT_NAME.fullmatch(name):
                raise ValueError(
                    f"condition name {name!r} in conditions.settings: use lower-case letters, digits and underscores, "
                    f"and begin with a letter"
                )
            if "trials" in condition.evaluate:
                raise ValueError(f"{where}.evaluate.trials: remove it; conditions.trials holds for all conditions")
            if "frequency" in condition.physics or "control_frequency" in condition.evaluate:
                raise ValueError(f"{where}: remove its frequency, which must be the same under all conditions")
            for engine in self.conditions.engines_of(name):
                try:
                    under(condition, engine, self.evaluate, self.physics)
                except ValueError as error:
                    raise ValueError(f"{where} with {engine}: {error}") from error

    @model_validator(mode="after")
    def _stages_agree(self) -> Parameters:
        samples = self.prepare.surface_points
        if self.synthesize.energy.object_points > samples:
            raise ValueError(f"synthesize.energy.object_points must not exceed prepare.surface_points ({samples})")
        if self.physics.frequency % self.evaluate.control_frequency:
            raise ValueError(f"evaluate.control_frequency must divide physics.frequency ({self.physics.frequency})")
        return self

    def is_asset(self, name: str) -> bool:
        """Return whether an object's name is one that a source under ``assets`` gives."""
        return any(name.startswith(f"{source}_") for source in self.assets)

    def with_assets(self) -> Parameters:
        """Return the parameters with the objects from packages in their styles, as prepare has found them.

        Raises:
            UserError: prepare has not run.
        """
        if not self.assets:
            return self
        found = styles_of_assets(read_catalogue(paths.CATALOGUE_FILE), self.assets)
        merged = {style: list(dict.fromkeys([*own, *found.get(style, ())])) for style, own in self.styles}
        return self.model_copy(update={"styles": StylesParameters(**merged)})

    def sequences(self) -> list[tuple[str, ...]]:
        """Return the objects of every sequence, in the order of picking."""
        own = [objects_of(pick, dict(self.styles)) for pick in self.picks]
        return sequences(own, self.pairs, self.seed)

    def partners(self) -> dict[str, tuple[str, ...]]:
        """Return, for each first object, the objects that are picked after it in a sequence of two."""
        found: dict[str, list[str]] = {first: [] for first in objects_of(self.picks[0], dict(self.styles))}
        for first, second, *_ in self.sequences():
            found[first].append(second)
        return {first: tuple(seconds) for first, seconds in found.items()}

    def tried_partners(self) -> dict[str, tuple[str, ...]]:
        """Return the :meth:`partners` with which the robot tries grasps: not those that are for training alone."""
        return {first: own for first, own in self.partners().items() if own and is_tried(first, self.pairs)}


def _inside(path: str, folder: Path) -> bool:
    """Return whether a path is below a folder of the repository."""
    return Path(path).is_relative_to(folder) and Path(path) != folder and ".." not in Path(path).parts


def read_parameters(source: Path = paths.PARAMETERS_FILE) -> Parameters:
    """Read and check all parameters.

    Raises:
        UserError: the file is missing or not YAML, or a value is invalid, unknown or missing.
    """
    try:
        content = parse_yaml(source.read_text())
    except FileNotFoundError as error:
        raise UserError(
            f"{source} is missing; run in the root of the repository, or restore it with `git checkout {source}`."
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"{source} is not valid YAML: {' '.join(str(error).split())}; correct it there.") from error
    if not isinstance(content, dict):
        raise UserError(f"{source} holds no parameters; restore it with `git checkout {source}`.")
    try:
        return Parameters.model_validate(content)
    except ValidationError as error:
        more = f" ({error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise UserError(f"{source}: {first_mistake(error)}{more}.") from error


def load_parameters(sections: Collection[str], source: Path = paths.PARAMETERS_FILE) -> dict[str, Any]:
    """Check all parameters and return only the named sections.

    Args:
        sections: dotted names as in ``params:`` of ``dvc.yaml``, such as ``synthesize.pinch``.

    Raises:
        UserError: see :func:`read_parameters`; or a section, such as an object, does not exist; or a section concerns
            two objects and the hand is not the Allegro.
    """
    return load_with_workers(sections, source)[0]


def load_with_workers(
    sections: Collection[str], source: Path = paths.PARAMETERS_FILE
) -> tuple[dict[str, Any], ComputeParameters]:
    """Return the sections as :func:`load_parameters` does, and where items run, which no result depends on."""
    parameters = read_parameters(source)
    if any(name.split(".")[0] in ("styles", "conditions") for name in sections):
        parameters = parameters.with_assets()
    if any(name.split(".")[0] in _OF_SEQUENCES for name in sections):
        require_picks(parameters, source)
    if any(name.split(".")[0] == "conditions" for name in sections):
        require_conditions(parameters, source)
    return {name: _section(parameters, name, source) for name in sections}, parameters.compute


def chosen_sequences(parameters: Mapping[str, Any], first: str = "") -> list[tuple[str, ...]]:
    """Return the objects of every sequence, in the order of picking.

    Args:
        parameters: the sections ``seed``, ``styles``, ``pairs`` and ``picks``, and any others.
        first: return only the sequences that begin with this object, if given.

    Raises:
        UserError: there is no such first object.
    """
    picks, styles = parameters["picks"], dict(parameters["styles"])
    own = [objects_of(pick, styles) for pick in picks]
    if first and first not in own[0]:
        raise UserError(
            f"{paths.PARAMETERS_FILE}: styles.{picks[0].style} does not list {first!r}; add it there, or use one of "
            f"{', '.join(own[0]) or 'none'}."
        )
    return [names for names in sequences(own, parameters["pairs"], parameters["seed"]) if first in ("", names[0])]


def tried_sequences(parameters: Mapping[str, Any], first: str = "") -> list[tuple[str, ...]]:
    """Return the :func:`chosen_sequences` for which the model is sampled, and which the robot tries.

    Raises:
        UserError: as there, or pairs that begin with ``first`` are for training alone.
    """
    if first and not is_tried(first, parameters["pairs"]):
        raise UserError(
            f"{paths.PARAMETERS_FILE}: pairs that begin with {first} are for training alone; take its source out of "
            "pairs.only_trained, or use another object."
        )
    return [names for names in chosen_sequences(parameters, first) if is_tried(names[0], parameters["pairs"])]


def second_objects(sequences: Sequence[tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Return, for each first object of sequences of two, the objects that are picked after it.

    Raises:
        UserError: sequences are longer than two.
    """
    found: dict[str, list[str]] = {}
    for names in sequences:
        if len(names) != 2:
            raise UserError(
                f"{paths.PARAMETERS_FILE}: picks has {len(names)} entries, but the learned model knows two objects; "
                "run `./dev repro evaluate@synthesized`, which does without it, or name two."
            )
        found.setdefault(names[0], []).append(names[1])
    return {name: tuple(seconds) for name, seconds in found.items()}


def require_picks(parameters: Parameters, source: Path = paths.PARAMETERS_FILE) -> None:
    """Check that the hand grasps in the styles of all picks.

    Raises:
        UserError: it does not.
    """
    for style in dict.fromkeys(pick.style for pick in parameters.picks):
        if not getattr(parameters.synthesize, style).finger_sets:
            raise UserError(
                f"{source}: the hand {parameters.hand} has no {style} grasps (synthesize.{style}.finger_sets is "
                "empty), so that it cannot carry out `picks`; run `./dev repro validate@pinch` for grasps of single "
                "objects, or choose another hand."
            )


def require_conditions(parameters: Parameters, source: Path = paths.PARAMETERS_FILE) -> None:
    """Refuse conditions (:class:`UserError`) that do not agree with what else the file says."""
    try:
        parameters.check_conditions()
    except ValueError as error:
        raise UserError(f"{source}: {str(error).removesuffix('.')}.") from error


def _section(parameters: Parameters, name: str, source: Path) -> Any:
    value: Any = parameters
    for part in name.split("."):
        if isinstance(value, dict):
            section = name.split(".")[0]
            require_name(part, value, section, kind=_KINDS.get(section, "object"), source=source)
            value = value[part]
        else:
            value = getattr(value, "validate_" if part == "validate" else part)
    return value
