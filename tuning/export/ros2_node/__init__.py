"""Files of the exported ROS 2 node that are the same for every law."""
