"""Stage track: record the result in MLflow."""
