"""Stage assets: mesh files and their licences out of packages, which are taken apart, not installed."""
