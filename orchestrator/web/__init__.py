"""A loop as a page that flies it: the parts of `desat export web`."""
