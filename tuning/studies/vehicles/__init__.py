"""Vehicles in the MuJoCo physics engine, on which gains are tried that were tuned on the models of `agvjax.plants`."""
