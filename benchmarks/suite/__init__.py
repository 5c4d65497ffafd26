"""Small systems as SSP files, each about one thing, for hosts and importers."""
