"""What runs a checked system: master, instances, recorder."""
