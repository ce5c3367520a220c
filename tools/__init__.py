"""Commands around the pipeline: set-up, scales, objects and captures of one's own, publishing, audit, the site of the docs."""
