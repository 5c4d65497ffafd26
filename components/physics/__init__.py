"""Models of the spacecraft, its actuators and what is around it, as functions."""
