"""ROS 2 over Zenoh, as rmw_zenoh speaks it, without ROS: what a cell feels goes out, a sensor or an arm comes in."""
