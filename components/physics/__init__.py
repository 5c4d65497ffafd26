"""Model the spacecraft, its actuators and its environment as functions."""
