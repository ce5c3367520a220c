"""Stage synthesize: grasp candidates of one object in one style."""
