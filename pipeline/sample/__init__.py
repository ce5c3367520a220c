"""Stage sample: grasps drawn from the model, refined, ranked and checked."""
