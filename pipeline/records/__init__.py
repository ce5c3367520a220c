"""Table schemas, typed parameters, paths and errors: the only room that knows file layouts."""
