"""What was studied with the tools: the paper, its rivals, vehicles."""
