import pytest

from pipeline.track import store


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory):
    """A new database without experiments; making one takes seconds."""
    root = tmp_path_factory.mktemp("database")
    store.open_client(root).search_experiments()
    return root / "mlflow.db"
