"""Stage report: one offline page and the summary of headline figures."""
