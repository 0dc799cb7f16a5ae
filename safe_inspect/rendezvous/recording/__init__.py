"""Sensor logs: measurements of the camera and the inertial unit on disk, independent of the simulator."""
