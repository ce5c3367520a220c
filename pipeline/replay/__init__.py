"""Runs a recorded trial again: compares it, plays it in a browser, writes a video."""
