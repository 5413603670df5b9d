"""A tuned controller without Python, or without JAX: C, FMU, NumPy, ROS 2, Nav2, StableHLO, all from the one law."""

FORMATS = {  # by the word of `--format`, the module with `NAME` and `files(artefact, name)`: a new form is a row here
    "c": "tuning.export.c",
    "fmu": "tuning.export.fmu",
    "nav2": "tuning.export.nav2",
    "numpy": "tuning.export.numpy",
    "ros2": "tuning.export.ros2",
    "stablehlo": "tuning.export.stablehlo",
}
PLANTS = {"fmu": "tuning.export.fmu.plant"}  # those that can be of the vehicle too, by `--what plant`
