import pytest

from pipeline.records.captures import read_capture
from tests.reconstruct.made_up import mapping, rendered


@pytest.fixture(scope="session")
def capture_folder(made_once):
    """A rendered capture; tests that change something copy it."""
    return made_once("capture", rendered)


@pytest.fixture(scope="session")
def photos(capture_folder):
    from pipeline.reconstruct.photos import read_photos

    return read_photos(read_capture(capture_folder), 480)


@pytest.fixture(scope="session")
def sparse(photos):
    """The poses of the rendered capture, found once for all tests."""
    from pipeline.reconstruct.sparse import sparse_model

    return sparse_model(photos, None, mapping(), seed=1)


@pytest.fixture(scope="session")
def sightings(photos, capture_folder):
    from pipeline.reconstruct.tags import detect_tags

    layout = read_capture(capture_folder).tags
    return {photo.name: detect_tags(photo, layout) for photo in photos}
