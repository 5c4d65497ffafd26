"""What laws need beforehand: a file a kind of design."""
