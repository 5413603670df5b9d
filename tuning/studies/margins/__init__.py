"""How far a tuned loop is from losing its stability: margins of gain, phase and delay at every actuator."""
