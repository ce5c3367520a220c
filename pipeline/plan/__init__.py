"""One sequence as way-points for a real robot, checked against its limits and, on request, run in simulation first."""
