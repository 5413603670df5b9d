"""What each command of `agvjax` does, from parsed arguments to a run folder."""
