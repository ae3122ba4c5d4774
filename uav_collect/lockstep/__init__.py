"""How nodes keep in step, without ROS: who flies what, what is heard when, which policy counts."""
