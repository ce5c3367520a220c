"""Commands around the pipeline: setup, scales, your own objects and captures, publishing, audit, documentation site."""
