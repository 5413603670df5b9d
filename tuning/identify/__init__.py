"""From a log to a scenario: what the actuators of a vehicle really do, and how surely that is known."""
