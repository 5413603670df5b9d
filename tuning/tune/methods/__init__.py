"""The methods that step from gains to better gains, one a file."""
