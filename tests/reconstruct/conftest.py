import pytest

from pipeline.records.captures import read_capture
from tests.reconstruct.made_up import quick, rendered


@pytest.fixture(scope="session")
def capture_folder(made_once):
    """A rendered capture; tests that change something copy it."""
    return made_once("capture", rendered)


@pytest.fixture(scope="session")
def photos(capture_folder):
    from pipeline.reconstruct.photos import read_photos

    return read_photos(read_capture(capture_folder), 480)


@pytest.fixture(scope="session")
def seen(photos, capture_folder):
    from pipeline.reconstruct.detection import seen_tags

    layout = read_capture(capture_folder).tags
    return {photo.name: seen_tags(photo.grey, layout) for photo in photos}


@pytest.fixture(scope="session")
def sightings(seen):
    return {name: its.tags for name, its in seen.items()}


@pytest.fixture(scope="session")
def cameras(photos, seen, capture_folder):
    """The cameras of the rendered capture, found once for all tests."""
    from pipeline.reconstruct.cameras import find_cameras

    capture = read_capture(capture_folder)
    return find_cameras(photos, seen, capture.tags, capture.scene, None, quick(), seed=1)
