import os

from pipeline.compute.fan_out import fan_out, worker_count
from tests.compute.items import draw


def threads_of_libraries(_: int) -> str:
    return os.environ["OMP_NUM_THREADS"] + os.environ["OPENBLAS_NUM_THREADS"]


def test_results_do_not_depend_on_the_number_of_workers():
    items = list(range(12))
    expected = [draw(item) for item in items]
    assert fan_out(draw, items, workers=1, label="one") == expected
    assert fan_out(draw, items, workers=2, label="two") == expected


def test_no_items_give_no_results():
    assert fan_out(draw, [], workers=2, label="none") == []


def test_workers_compute_on_one_thread():
    assert set(fan_out(threads_of_libraries, list(range(4)), workers=2, label="threads")) == {"11"}


def test_zero_means_every_usable_core():
    assert worker_count(0) == len(os.sched_getaffinity(0))
    assert worker_count(7) == 7


def test_progress_goes_to_stderr(capsys):
    fan_out(draw, [1, 2], workers=1, label="drawing")
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "drawing" in captured.err
