"""The panel beside the picture: controls, what they offer, and the words about the rows that are shown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from pipeline.view import facts, rows
from pipeline.view.choice import ARRANGEMENTS, Choice
from pipeline.view.scenes import JOINTS, ONE, STANDARD, Layers
from pipeline.view.tables import CANDIDATES_VIEW, MERGED_VIEW, RECONSTRUCTIONS, TRIALS_VIEW, VALIDATED_VIEW, VIEWS

ALL = "all"
GRASPS = (CANDIDATES_VIEW, VALIDATED_VIEW, MERGED_VIEW)
SINGLE_GRASPS = (CANDIDATES_VIEW, VALIDATED_VIEW)
# Filters with their labels, by view.
LABELS = {
    "source": {MERGED_VIEW: "made by", TRIALS_VIEW: "grasps", RECONSTRUCTIONS: "capture"},
    "style": dict.fromkeys(SINGLE_GRASPS, "style"),
    "first": {
        **dict.fromkeys(SINGLE_GRASPS, "object"),
        **dict.fromkeys((MERGED_VIEW, TRIALS_VIEW), "first object"),
    },
    "second": dict.fromkeys((MERGED_VIEW, TRIALS_VIEW), "second object"),
    "reason": {**dict.fromkeys(GRASPS, "reject reason"), TRIALS_VIEW: "failure reason"},
    "outcome": dict.fromkeys((*GRASPS, TRIALS_VIEW), "outcome"),
}
# Layers with their labels and views; all but the last are for a single row.
LAYERS = {
    "contacts": ("contacts", SINGLE_GRASPS),
    "samples": ("surface samples", SINGLE_GRASPS),
    "parts": ("convex parts", SINGLE_GRASPS),
    "hand_candidates": ("hand's candidates", GRASPS),
    "see_through": ("see through", GRASPS),
}
OF_MANY = "see_through"  # the layer that also many rows have
PREVIOUS, NEXT = "◀ previous", "next ▶"


class Panel:
    """The controls of the page."""

    def __init__(self, gui: Any) -> None:
        """Add the controls.

        Args:
            gui: of a viser server; its types hide that values can be set.
        """
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        gui.main_panel.dock_right()
        gui.set_panel_label("What the pipeline made")
        self.notice = gui.add_markdown("", visible=False)
        self.view = gui.add_dropdown("show", VIEWS)
        self.arrangement = gui.add_dropdown("arranged", next(iter(ARRANGEMENTS.values())))
        self.filters = {column: gui.add_dropdown(column, (ALL,)) for column in rows.FILTERS}
        self.legend = gui.add_html("")
        self.heading = gui.add_markdown("")
        self.arrows = gui.add_button_group("row", (PREVIOUS, NEXT))
        self.moment = gui.add_dropdown("moment", ("",))
        self.joints = gui.add_dropdown("joints", (next(iter(JOINTS)),))
        self.text = gui.add_markdown("")
        self.related = gui.add_button_group("see also", ("object",))
        self.layers_folder = gui.add_folder("Layers")
        with self.layers_folder:
            self.layers = {
                name: gui.add_checkbox(label, getattr(STANDARD, name)) for name, (label, _) in LAYERS.items()
            }
        with gui.add_form(None) as self.form:
            self.name = gui.add_text("go to", "", hint=f"a row's name, such as {rows.EXAMPLE}")
        self.reload = gui.add_button("Read again", hint="after dvc repro, or a change of params.yaml")

    def say(self, sentence: str) -> None:
        """Show a notice; '' hides it."""
        self.notice.content, self.notice.visible = sentence, bool(sentence)

    def value_of(self, column: str) -> str:
        """Return what the filter of a column lets through."""
        text = self.filters[column].value
        return rows.ANY if text.startswith(f"{ALL} (") else text.rpartition(" (")[0]

    def chosen_layers(self) -> Layers:
        """Return which layers are ticked."""
        return Layers(**{name: bool(box.value) for name, box in self.layers.items()})

    def show_filters(self, choice: Choice, index: pd.DataFrame) -> None:
        """Bring view, arrangement, filters and legend in line with a choice of the rows of ``index``."""
        self.view.value = choice.view
        offer(self.arrangement, ARRANGEMENTS[choice.view], choice.arrangement)
        for column, control in self.filters.items():
            label = LABELS[column].get(choice.view, "")
            control.visible = bool(label) and not index.empty
            counts = rows.choices(index, choice.filters, column)
            if label:
                control.label = label
            options = {rows.ANY: f"{ALL} ({sum(counts.values())})"}
            options |= {value: f"{value} ({count})" for value, count in counts.items()}
            offer(control, options.values(), options[choice.filters[column]])
        colours = rows.reason_colours(sorted(index["reason"].unique()))
        self.legend.content = facts.legend(rows.counted(rows.selected(index, choice.filters)), colours)

    def show_controls(self, choice: Choice, count: int) -> None:
        """Show the controls that do something for a choice of ``count`` rows, and no words about any row."""
        grasps = count > 0 and choice.view in GRASPS
        for name, (_, views) in LAYERS.items():
            fits = choice.arrangement == ONE or name == OF_MANY
            self.layers[name].visible = count > 0 and fits and choice.view in views
        self.layers_folder.visible = self.joints.visible = grasps
        self.arrows.visible = count > 0
        self.moment.visible = self.related.visible = False
        self.heading.content = self.text.content = ""

    def show_moments(self, phases: Sequence[str], moment: int) -> None:
        """Offer the moments of a trial; ``moment`` is shown."""
        if phases:
            self.moment.visible = True
            options = [f"{number + 1}. {name}" for number, name in enumerate(phases)]
            offer(self.moment, options, options[moment])

    def show_related(self, links: Mapping[str, str]) -> None:
        """Offer what a row leads to."""
        if links:
            self.related.visible = True
            self.related.options = tuple(links)


def offer(control: Any, options: Iterable[str], value: str) -> None:
    """Set what a control offers, and its value where it is among that."""
    options = tuple(options)
    if tuple(control.options) != options:
        control.options = options
    if value in options:
        control.value = value
