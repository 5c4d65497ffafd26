"""Run a checked system: master, instances, recorder."""
