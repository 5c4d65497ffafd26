"""A target prepared as a case, run, supervised, resumed, and told as a manifest."""
