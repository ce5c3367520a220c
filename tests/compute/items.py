"""Items that every backend is given; importable, as workers import them."""

from pipeline.records.seeds import item_generator


def draw(index: int) -> list[float]:
    return item_generator(1, "test", "cube", index).normal(size=3).tolist()


def fail_on_three(index: int) -> int:
    if index == 3:
        raise LookupError("item three")
    return index
