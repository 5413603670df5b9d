"""A local page with sliders: gains, deadzone, delay and disturbance moved by hand, the run redrawn at once."""
