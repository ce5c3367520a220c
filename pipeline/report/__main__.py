"""Command of the report: one offline page, its figures, the data card, and the summary of every headline number."""

from __future__ import annotations

import argparse

from pipeline.records import paths
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage
from pipeline.records.versions import installed_versions
from pipeline.records.writing import whole_file, whole_folder, write_json


def sections() -> list[str]:
    """Parameter sections that the stage declares: all that its page shows, so all on which results depend."""
    shown = ["scale", "seed", "styles", "objects", "meshes", "renderings", "captures", "reconstructed"]
    single = ["prepare", "synthesize", "physics", "validate"]
    return [*shown, *single, "merge", "train", "evaluate", "harder", "reconstruct", "report"]


def work() -> None:
    """Read every table, count, draw, and write the page, the figures, the card and the summary."""
    parameters = load_parameters(sections())
    from pipeline.records.tables import MERGED
    from pipeline.report.dataset_card import CardContent, ObjectFacts, dataset_card
    from pipeline.report.diversity import diversity
    from pipeline.report.drawing import draw_views, load_objects
    from pipeline.report.figure_files import heat_map_picture
    from pipeline.report.harder import PREFIX, load_harder
    from pipeline.report.learned import load_learned
    from pipeline.report.page import PageContent, build_page
    from pipeline.report.rates import pair_merge, pair_trials, single_grasp_funnel
    from pipeline.report.reconstructed import load_reconstructed
    from pipeline.report.scene import UNIT
    from pipeline.report.settings import section_rows
    from pipeline.report.summary import summarize
    from pipeline.report.tables import load_tables
    from pipeline.report.trial_rows import trials_table

    styles, evaluate = parameters["styles"], parameters["evaluate"]
    settings = {name: list(section_rows(name, value)) for name, value in parameters.items()}
    settings = {"run": settings.pop("scale") + settings.pop("seed"), **settings}
    tables = load_tables(styles, parameters["reconstructed"])
    funnels = [
        single_grasp_funnel(style, name, candidates, tables.validated[style, name])
        for (style, name), candidates in tables.candidates.items()
    ]
    merges = [pair_merge(first, second, merged) for (first, second), merged in tables.merged.items()]
    trials = {
        source: [pair_trials(first, second, tables.trials[source, first]) for first, second in tables.merged]
        for source in paths.SOURCES
    }
    chosen = parameters["reconstructed"]
    if chosen:
        trials[paths.RECONSTRUCTED] = [
            pair_trials(first, second, tables.trials[paths.RECONSTRUCTED, first])
            for first, item in chosen.items()
            for second in item.side
        ]
    learned = load_learned(styles)
    reconstructed = load_reconstructed(parameters["captures"])
    metrics = {name: one.metrics for name, one in reconstructed.items()}
    harder = load_harder(parameters["harder"], evaluate, parameters["physics"], tables.trials)
    summary = summarize(parameters["scale"], funnels, merges, trials, metrics, learned, harder)
    workers = read_parameters().compute.workers
    objects = load_objects(tables)
    used, pair_diversities = diversity(tables)
    card = CardContent(
        scale=parameters["scale"],
        seed=parameters["seed"],
        funnels=funnels,
        merges=merges,
        used=used,
        diversity=pair_diversities,
        distinct_distance=parameters["merge"].distinct_distance,
        objects=[
            ObjectFacts(name, one.provenance["source"], one.provenance["licence"], one.extents.tolist(), one.mass)
            for name, one in objects.items()
        ],
        columns=MERGED,
        versions=installed_versions(),
        settings=settings,
    )
    views, shapes = draw_views(tables, objects, parameters["report"], evaluate, workers)
    content = PageContent(
        summary=summary,
        funnels=funnels,
        merges=merges,
        trials=trials,
        views=views,
        trial_tables={
            **{
                (source, one.first, one.second): trials_table(
                    source, one.first, one.second, tables.trials[source, one.first]
                )
                for source, pairs in trials.items()
                for one in pairs
            },
            **{
                (PREFIX + setting.name, one.first, one.second): trials_table(
                    PREFIX + setting.name, one.first, one.second, setting.rows
                )
                for setting in harder
                for one in setting.pairs
            },
        },
        shapes=shapes,
        shape_unit=UNIT,
        success_height=evaluate.success_height,
        hold_seconds=evaluate.hold_seconds,
        hand_torque_limit=parameters["physics"].hand_torque_limit,
        versions=installed_versions(),
        settings=settings,
        learned=learned,
        reconstructed=reconstructed,
        harder=harder,
    )
    from plotly.offline import get_plotlyjs

    page = build_page(content, get_plotlyjs())
    with whole_folder(paths.FIGURES_FOLDER) as folder:
        for source, pairs in trials.items():
            (folder / f"success-{source}.png").write_bytes(heat_map_picture(pairs))
        for view in views:
            for strip in view.strips:
                kind = "failure" if strip.failed else "success"
                (folder / f"{view.name}-{strip.source}-{kind}.jpg").write_bytes(strip.sheet)
    with whole_file(paths.REPORT_PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8")
    with whole_file(paths.DATASET_CARD) as temporary:
        temporary.write_text(dataset_card(card), encoding="utf-8")
    write_json(paths.SUMMARY_FILE, summary)


def main() -> int:
    """Parse the command line and run the stage."""
    argparse.ArgumentParser(prog="python -m pipeline.report", description=__doc__).parse_args()
    return run_stage("report", work)


if __name__ == "__main__":
    raise SystemExit(main())
