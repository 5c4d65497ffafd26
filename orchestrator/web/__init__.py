"""Export a loop as a page that flies it (`desat export web`)."""
