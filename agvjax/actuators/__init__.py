"""What stands between a command and what is delivered: the deadzone, and elements in any order as a chain."""
