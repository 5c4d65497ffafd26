"""Read telemetry, fit a craft to it, and lay it over a run."""
