"""Commands around the pipeline: set-up, scales, own objects and captures, publishing, audit, the site of the docs."""
